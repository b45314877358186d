# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Requests that cost time, to each node as a process: after each of them a friend is answered, within 2 s of its processor.

COSTS_SEED chooses others; tests/long/test_fuzz.py sends many more, to a robot.
"""

import json
import os
import pathlib
import subprocess
import sys

import pytest

from tests.unit.nodes.test_master_discovery import NAMESPACE, NODES, has_namespaces

pytestmark = pytest.mark.whole

HERE = pathlib.Path(__file__).parent
PATHS = [NODES, HERE, HERE.parents[2] / "lab/nodes/hostile", os.environ.get("PYTHONPATH", "")]
COUNT, WITHIN = 8, 2.0  # requests to a node; seconds of a processor
SEED = os.environ.get("COSTS_SEED", "1")


@pytest.mark.skipif(not has_namespaces(), reason="needs unshare and ip, and network namespaces for this user")
@pytest.mark.parametrize("node", ["discovery", "sync", "relay", "roscore"])
def test_a_friend_is_answered_after_each_costly_request(node, tmp_path):
    words = [sys.executable, str(HERE / "running_attacks.py"), node, SEED, str(COUNT), str(tmp_path)]
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
    assert len(found) == COUNT
    assert node == "sync" or "200" in {one[-1] for one in found}, "some of it was read"
    assert [one for one in found if not one[3] or one[4] > WITHIN] == [], f"COSTS_SEED={SEED}"
