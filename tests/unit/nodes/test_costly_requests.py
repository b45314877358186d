# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Requests that cost time, to each node as a process: after each of them a friend is answered, within 2 s of its processor.

COSTS_SEED chooses others; tests/long/test_fuzz.py sends many more, to a robot.
"""

import json
import os

import pytest
from namespaces import run_alone, why_not_alone

pytestmark = pytest.mark.whole

COUNT, WITHIN = 8, 2.0  # requests to a node; seconds of a processor
SEED = os.environ.get("COSTS_SEED", "1")


@pytest.mark.skipif(bool(why_not_alone()), reason=why_not_alone())
@pytest.mark.parametrize("node", ["discovery", "sync", "relay", "roscore"])
def test_a_friend_is_answered_after_each_costly_request(node, tmp_path):
    found = json.loads(run_alone("running_attacks.py", node, SEED, COUNT, tmp_path, log=tmp_path / "log"))
    print(*found, sep="\n")
    assert len(found) == COUNT
    assert node == "sync" or "200" in {one[-1] for one in found}, "some of it was read"
    assert [one for one in found if not one[3] or one[4] > WITHIN] == [], f"COSTS_SEED={SEED}"
