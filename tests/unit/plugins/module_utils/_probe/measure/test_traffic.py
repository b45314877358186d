# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The traffic of a robot to others: answers of real nodes, of strange ones, and nodes over real sockets."""

import time
from types import SimpleNamespace

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.measure import traffic
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.ros_client.ros import Ros
from hypothesis import given
from hypothesis import strategies as st

MEMBERS = [
    {"name": "here", "address": "127.0.0.1", "discovery_address": "", "robot": "one"},
    {"name": "there", "address": "127.0.0.2", "discovery_address": "", "robot": "two"},
    {"name": "behind", "address": "127.0.0.3", "discovery_address": "", "robot": "three"},
]

# Of nodes of ROS Noetic: a rospy publisher with three subscribers, and topic_tools' relay (roscpp), which overwrites code and text.
ROSPY = [
    1,
    "",
    [
        [
            ["/rosout", 0, [[1, 1262, 0, True]]],
            ["/ana/scan", 1740000, [[2, 1740163, 174, True], [3, 1610163, 161, True], [4, 1590163, 159, True]]],
        ],
        [],
        [],
    ],
]
ROSCPP = [
    [["/rosout", [[0, 147, 147, 1, 0]]], ["/ana/relayed", [[2, 1930000, 1930000, 193, 0]]]],
    [["/ana/scan", [[1, 2039184, 204, 0, 0]]]],
]


def test_counters_of_rospy():
    assert traffic.counters(ROSPY) == {1: (1262, 0), 2: (1740163, 174), 3: (1610163, 161), 4: (1590163, 159)}


def test_counters_of_roscpp():
    assert traffic.counters(ROSCPP) == {0: (147, 1), 2: (1930000, 193)}


@pytest.mark.parametrize(
    "entry", [[1, 2, 3], [1, "2", 3, 4], [1, 10**300, 3, True], "1234", [1, 2, 3.5, 4], [None] * 4]
)
def test_a_connection_with_strange_counters_is_left_out(entry):
    assert traffic.counters([1, "", [[["/x", 0, [entry, [7, 8, 9, True]]]], [], []]]) == {7: (8, 9)}


nonsense = st.recursive(
    st.none() | st.integers() | st.text(max_size=9), lambda inner: st.lists(inner, max_size=6), max_leaves=30
)


@given(nonsense)
def test_any_answer_is_read(answer):
    traffic.counters(answer)


def flows(first, second, seconds=2.0):
    sent = {1: ("/scan", "two"), 2: ("/scan", "two"), 3: ("/map", "three")}
    return traffic.list_flows("/base", sent, (10.0, first), (10.0 + seconds, second))


def test_a_rate_is_the_sum_over_the_subscribers():
    assert flows({1: (100, 1), 2: (500, 5), 3: (0, 0)}, {1: (300, 3), 2: (900, 9), 3: (7, 1), 4: (9, 9)}) == [
        {"node": "/base", "topic": "/scan", "robot": "two", "subscribers": 2, "bytes_s": 300.0, "messages_s": 3.0},
        {"node": "/base", "topic": "/map", "robot": "three", "subscribers": 1, "bytes_s": 3.5, "messages_s": 0.5},
    ]


@pytest.mark.parametrize("later", [{}, {1: (99, 5)}, {1: (200, 0)}, {2: (500, 5)}])
def test_a_counter_that_went_back_gives_no_rate(later):
    assert flows({1: (100, 1)}, later) == []


def test_no_rate_without_time_between():
    assert flows({1: (100, 1)}, {1: (200, 2)}, 0.0) == []


def test_the_32_bits_of_roscpp_go_on_below_zero():
    (flow,) = flows({1: (-(2**31), 1)}, {1: (-(2**31) + 800, 3)})
    assert (flow["bytes_s"], flow["messages_s"]) == (400.0, 1.0)


class Node:
    """A node as far as its connections go. Each reading has sent a hundred messages of 1,000 bytes more on each of them."""

    def __init__(self, *links, topic="/scan", wait=0.0):
        self.links, self.topic, self.wait, self.asked = links, topic, wait, 0

    def getBusInfo(self, caller):
        time.sleep(self.wait)
        words = "TCPROS connection on port 40433 to [{}:41233 on socket 9]"
        return 1, "", [[number, "/ear", "o", "TCPROS", self.topic, True, words.format(to)] for number, to in self.links]

    def getBusStats(self, caller):
        self.asked += 1
        entries = [[number, 100000 * self.asked, 100 * self.asked, True] for number, _to in self.links]
        return 1, "", [[[self.topic, 0, entries]], [], []]


@pytest.fixture
def robot(tmp_path, served, monkeypatch):
    """Measure on a roscore with these nodes, of which /planner is another robot's."""
    monkeypatch.setattr(traffic, "SECONDS", 0.2)
    monkeypatch.setattr(traffic, "READING", 1.0)

    class Master:
        def getSystemState(self, caller):
            return 1, "", [[["/scan", sorted(uris)]], [], []]

        def lookupNode(self, caller, node):
            return 1, "", uris[node]

    uris = {}
    (tmp_path / "environment").write_text(f"ROS_MASTER_URI={served(Master())}\n")

    def measure(**nodes):
        uris.update({f"/{name}": served(node) for name, node in nodes.items()}, **{"/planner": "http://127.0.0.2:1/"})
        return traffic.measure_traffic(Ros(str(tmp_path / "environment")), MEMBERS, "here")

    return measure


@pytest.fixture
def clock(monkeypatch):
    """Time goes on only where it is slept: the figures are exact, and each reading comes in time."""
    now = [1000.0]
    by_hand = SimpleNamespace(monotonic=lambda: now[0], sleep=lambda seconds: now.append(now.pop() + seconds))
    monkeypatch.setattr(traffic, "time", by_hand)
    monkeypatch.setattr(traffic, "READING", 60.0)


def test_only_what_goes_to_other_robots_is_measured(robot, clock, monkeypatch):
    monkeypatch.setattr(traffic, "SECONDS", 0.5)
    near = Node((1, "127.0.0.1"))
    far = Node((1, "127.0.0.2"), (2, "127.0.0.2"), (3, "127.0.0.3"), (4, "127.0.0.1"), (5, "203.0.113.9"))
    found = robot(near=near, far=far, multimaster_verify_talker=Node((1, "127.0.0.2")))
    assert [(flow["node"], flow["topic"], flow["robot"], flow["subscribers"]) for flow in found["flows"]] == [
        ("/far", "/scan", "two", 2),
        ("/far", "/scan", "three", 1),
    ]
    assert found["seconds"] == 0.5 and near.asked == 0
    assert [(flow["bytes_s"], flow["messages_s"]) for flow in found["flows"]] == [(400000.0, 400.0), (200000.0, 200.0)]


@pytest.mark.slow
def test_a_node_that_hangs_costs_the_others_nothing(robot):
    began = time.monotonic()
    found = robot(hung=Node((1, "127.0.0.2"), wait=4.0), far=Node((1, "127.0.0.2")))
    assert [flow["node"] for flow in found["flows"]] == ["/far"]
    assert time.monotonic() - began < 3.5


def test_nothing_is_waited_for_where_nothing_crosses(robot, monkeypatch):
    monkeypatch.setattr(traffic, "SECONDS", 60.0)
    assert robot(near=Node((1, "127.0.0.1")), long=Node((1, "127.0.0.2"), topic="/" + "x" * 300)) == traffic.NOTHING


def test_nothing_without_a_roscore(tmp_path):
    (tmp_path / "environment").write_text("ROS_MASTER_URI=http://127.0.0.1:1\n")
    assert traffic.measure_traffic(Ros(str(tmp_path / "environment")), MEMBERS, "here") == traffic.NOTHING
