# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The action multimaster_verify stops a talker by one command, reads the plan, and packs the answers of a large fleet."""

import json
import os
import subprocess
import sys
from dataclasses import asdict
from pathlib import Path

import fleets
import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._base.plain import to_plain
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observe.packed import unpack

pytestmark = pytest.mark.whole

ROOT = Path(__file__).resolve().parents[4]
FLEET = fleets.plan()
SEEN = to_plain(asdict(fleets.good(FLEET, fleets.ONE).probe))  # as a module returns it


@pytest.mark.parametrize("words", ["action=stop", "action=stopped", "state=stop", "state=stopped"])
def test_a_talker_is_stopped_without_a_module(words, tmp_path):  # there is no Python that could run it
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


def test_members_and_masters_come_from_the_plan_and_a_large_answer_is_packed(tmp_path):
    names = [f"pc{number}" for number in range(31)]
    fleet = {"members": [{"name": name, "address": "10.0.0.1"} for name in names], "masters": []}
    (tmp_path / "pc0.json").write_text(
        json.dumps({"multimaster_verify collect": {"changed": False, "msg": "", **SEEN}})
    )
    done = subprocess.run(
        [
            Path(sys.executable).with_name("ansible"),
            *("pc0", "-i", "pc0,", "-c", "recorded", "-m", "rosfleet.multimaster.multimaster_verify"),
            *("-a", "action=collect name=pc0 fleet=planned packed=true"),
            *("-e", json.dumps({"planned": fleet, "recorded_answers": str(tmp_path)})),
            *("-e", f"ansible_python_interpreter={sys.executable}"),
        ],
        cwd=tmp_path,
        env={
            **os.environ,
            "ANSIBLE_COLLECTIONS_PATH": str(ROOT / ".work/collections"),
            "ANSIBLE_CONNECTION_PLUGINS": str(ROOT / "tests/bench/connection"),
            "ANSIBLE_PIPELINING": "true",
            "ANSIBLE_HOME": str(tmp_path),
        },
        capture_output=True, text=True, timeout=300, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    result = json.loads(done.stdout.partition("=> ")[2])
    assert "members" not in result and unpack(result)["members"] == SEEN["members"]
