# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""A roscore as a process, which one address fills as far as it is let: the others register, and the memory is as it was counted."""

import json
import os
import pathlib
import subprocess
import sys

import pytest
from rosfleet_multimaster.roscore.core.bounds import BOUNDS, MIB

from tests.unit.nodes.test_master_discovery import NAMESPACE, NODES, has_namespaces

pytestmark = [pytest.mark.whole, pytest.mark.slow]

HERE = pathlib.Path(__file__).parent
PATHS = [NODES, HERE, HERE.parents[2] / "lab/nodes/hostile", os.environ.get("PYTHONPATH", "")]
WITHIN = 2.0  # seconds
#: Bytes that its process has beside what it holds: of its code, of a request with its answer, and of a store that is read.
BESIDE = 96 * MIB


@pytest.mark.skipif(not has_namespaces(), reason="needs unshare and ip, and network namespaces for this user")
def test_one_address_fills_its_share_and_others_register_before_and_after_a_kill(tmp_path):
    words = [sys.executable, str(HERE / "running_full_roscore.py"), str(tmp_path)]
    done = subprocess.run(
        [*NAMESPACE, *words],
        env={**os.environ, "PYTHONPATH": ":".join(map(str, PATHS))},
        timeout=300,
        capture_output=True,
        text=True,
        check=False,
    )
    log = tmp_path / "log"
    assert done.returncode == 0, done.stdout + done.stderr + (log.read_text() if log.exists() else "")
    found = json.loads(done.stdout)
    print(*found, sep="\n")
    counted = BOUNDS["registrations of one"].most + BOUNDS["parameters of one"].most
    for life in found:
        assert all("of the" in text and "another robot" in text for text in life["answers"])
        assert max(life["waits"]) < WITHIN
        assert life["peak"] < counted + BESIDE
