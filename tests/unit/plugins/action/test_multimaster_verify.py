# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The action multimaster_verify stops a talker by one command, without the module: there is no Python that could run it."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.whole

ROOT = Path(__file__).resolve().parents[4]


@pytest.mark.parametrize("words", ["action=stop", "action=stopped", "state=stop", "state=stopped"])
def test_a_talker_is_stopped_without_a_module(words, tmp_path):
    name = "rosfleet.multimaster.multimaster_verify"
    python = ("-e", "ansible_python_interpreter=/no/python")
    done = subprocess.run(
        [
            Path(sys.executable).with_name("ansible"),
            *("localhost", "-i", "localhost,", "-c", "local", "--check", "-m", name, "-a", words, *python),
        ],
        cwd=tmp_path,
        env={**os.environ, "ANSIBLE_COLLECTIONS_PATH": str(ROOT / ".work/collections"), "ANSIBLE_HOME": str(tmp_path)},
        capture_output=True, text=True, timeout=300, check=False,
    )  # fmt: skip
    assert done.returncode == 0 and "Check mode: no talker was stopped." in done.stdout, done.stdout + done.stderr
