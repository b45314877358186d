# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""5,000 registrations of a master at most: which ones, and who is told."""

import pathlib
import random
from dataclasses import replace

from hypothesis import given
from hypothesis import strategies as st
from rosfleet_multimaster.protocol.filters import Rules
from rosfleet_multimaster.protocol.graph import Node, State
from rosfleet_multimaster.protocol.messages import AnnouncedMaster
from rosfleet_multimaster.sync.core import report
from rosfleet_multimaster.sync.core.limits import MOST, limit_refusals, limit_state
from rosfleet_multimaster.sync.core.sync import Remote, select

URI, OWN = "http://robot2:11311/", "http://robot1:11311/"


def state(names, node="/n"):
    nodes = {node: Node("http://robot2:40000/", URI, "local")}
    types = dict.fromkeys(names, "std_msgs/String")
    return State(URI, "robot2", 1.0, 1.0, publishers=dict.fromkeys(names, (node,)), types=types, nodes=nodes)


def topics(found):
    return set(found.publishers)


def test_a_state_that_is_small_enough_is_taken_as_it_is():
    small = state([f"/t{number}" for number in range(MOST)])
    assert limit_state(small) is small


def test_of_80000_topics_5000_are_taken_and_it_says_so():
    taken = limit_state(state([f"/t{number:05}" for number in range(80_000)]))
    assert len(select(taken, Rules(), OWN, False)) == MOST
    assert (taken.left_out, len(taken.types)) == (75_000, MOST)
    remote = Remote(
        AnnouncedMaster("robot2", URI, "http://192.168.1.2:11611", "/d", 1.0, 1.0, True), Rules(), Rules(), taken
    )
    (refusal,) = limit_refusals({URI: remote})
    assert "robot2" in report.describe_refusal(refusal) and "5000" in report.describe_refusal(refusal)
    limits = report.diagnoses([refusal])[0]
    assert "1" in limits.message and limits.values[0][0] == "robot2"
    assert report.diagnoses([])[0].message == "OK"


def test_nodes_and_types_without_registrations_are_not_held():
    """40,000 nodes that register nothing took 9 MiB of each robot that offers them, and are of no use."""
    nodes = {f"/n{number}": Node("http://robot2:40000/", URI, "local") for number in range(40_000)}
    types = {f"/t{number}": "x/Y" for number in range(40_000)}
    for odd in ({"nodes": {**nodes, "/n": nodes["/n1"]}}, {"types": types}, {"providers": nodes}):
        taken = limit_state(replace(state(["/t1", "/t2"]), **odd))
        assert topics(taken) == {"/t1", "/t2"} and not taken.left_out
        assert len(taken.nodes) + len(taken.types) + len(taken.providers) < 10


NAMES = st.lists(st.integers(0, 30).map("/t{}".format), unique=True)


@given(NAMES, NAMES, st.integers(1, 20))
def test_what_was_taken_stays_whatever_else_is_offered(first, second, most):
    before = limit_state(state(first), None, most)
    after = limit_state(state(second), before, most)
    assert len(topics(after)) == min(most, len(second))
    assert topics(before) & set(second) <= topics(after)
    shuffled = random.Random(1).sample(second, len(second))
    assert topics(limit_state(state(shuffled), before, most)) == topics(after), (
        "the order of the document does not matter"
    )


def test_what_a_master_has_of_others_takes_no_room_from_its_own():
    """In a large fleet each robot's master has the registrations of all others."""
    others = {f"/a{number:05}": ("/imported",) for number in range(3 * MOST)}
    mine = {f"/t{number:05}": ("/n",) for number in range(MOST - 1)}
    there = replace(
        state([]),
        publishers={**others, **mine, "/tf": ("/imported",)},
        subscribers={"/tf": ("/n",)},
        types=dict.fromkeys([*others, *mine, "/tf"], "std_msgs/String"),
        nodes={
            "/n": Node("http://robot2:40000/", URI, "local"),
            "/imported": Node("http://robot3:40000/", "http://robot3:11311/", "remote"),
        },
    )
    taken = limit_state(there, None, MOST, OWN)
    assert len(select(taken, Rules(), OWN, False)) == MOST and taken.left_out == 0
    few = limit_state(replace(there, publishers={**others, "/tf": ("/imported",)}), None, MOST, OWN)
    assert (few.publishers, few.subscribers, few.left_out) == ({"/tf": ("/imported",)}, {"/tf": ("/n",)}, 0)


def test_the_verification_knows_the_same_number():
    text = (pathlib.Path(__file__).parents[5] / "plugins/plugin_utils/_verify/checks/exchange.py").read_text(
        encoding="utf-8"
    )
    assert f"\nMOST_REGISTRATIONS = {MOST} " in text
