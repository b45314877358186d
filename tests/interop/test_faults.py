# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Nodes and links that end, come back or get lost on one side, seen from the other. Each test waits until all is well again."""

import re

import pytest
from fleet import DIRECTIONS, NODES, OURS, ROBOTS, THEIRS, eventually, other, settled

both_ways = pytest.mark.parametrize(("giver", "taker"), DIRECTIONS, ids=lambda robot: robot.host)
either = pytest.mark.parametrize("robot", [OURS, THEIRS], ids=lambda robot: robot.host)


def exchange(name, seconds=45):
    """Something new crosses in both directions."""
    for giver, _taker in DIRECTIONS:
        giver.publish(f"/{name}_of_{giver.label}")
    for giver, taker in DIRECTIONS:
        topic = f"/{name}_of_{giver.label}"
        assert topic in eventually(taker.topics, lambda topics, topic=topic: topic in topics, seconds)
        assert taker.hears(topic), f"nothing arrives on {topic} at {taker.host}"


@both_ways
def test_a_node_restarts_under_its_name(giver, taker):
    topic = f"/again_{giver.label}"
    giver.publish(topic)
    taker.listen(topic)
    assert eventually(taker.heard, bool)
    giver.unpublish(topic)
    before = taker.heard()
    giver.publish(topic)
    assert eventually(taker.heard, lambda count: count > before) > before


@either
@pytest.mark.parametrize("node", NODES)
def test_a_discovery_or_sync_node_restarts(robot, node):
    far = other(robot)
    robot.publish("/lasting")
    far.listen("/lasting")
    assert eventually(far.heard, bool)
    robot.launch(node)
    settled()
    exchange("after_restart")
    before = far.heard()
    assert eventually(far.heard, lambda count: count > before) > before


@either
def test_a_roscore_restarts(robot):
    """Nodes come back by themselves: the bundled ones, and upstream's by their units. A user's own do not, in ROS 1."""
    far = other(robot)
    robot.publish("/before_restart")
    assert "/before_restart" in eventually(far.topics, lambda topics: "/before_restart" in topics)
    robot.unpublish("/before_restart")
    robot.run("systemctl restart multimaster-roscore")
    settled()
    assert "/before_restart" not in eventually(far.topics, lambda topics: "/before_restart" not in topics)
    exchange("after_roscore")


@either
def test_who_leaves_is_forgotten_at_once(robot):
    far = other(robot)
    robot.publish("/of_the_leaver")
    assert "/of_the_leaver" in eventually(far.topics, lambda topics: "/of_the_leaver" in topics)
    robot.run(f"systemctl stop {robot.unit('discovery')}")
    try:
        assert robot.host not in eventually(far.masters, lambda masters: robot.host not in masters, 8)
        assert "/of_the_leaver" not in eventually(far.topics, lambda topics: "/of_the_leaver" not in topics, 8)
    finally:
        robot.launch("discovery")
    settled()


# Who is killed, the parameters of its discovery, those of the other one's, seconds until it is offline at the latest.
# Upstream's 50 s (its timeout_factor is 10) and 300 s are cut down so that the test is short.
KILLED = {
    "ours": (OURS, {}, {"timeout_factor": 1.4, "remove_after": 20.0}, 15),
    "theirs": (THEIRS, {}, {"remove_after": 20.0}, 8),
    "theirs_at_its_own_rate": (
        THEIRS,
        {"heartbeat_hz": 0.02},
        {"active_request_after": 4.0, "remove_after": 20.0},
        20,
    ),
}


@pytest.mark.parametrize(("robot", "own", "others", "seconds"), KILLED.values(), ids=KILLED)
def test_who_is_killed_is_offline_and_then_removed(robot, own, others, seconds):
    far = other(robot)
    with robot.with_parameters("discovery", **own), far.with_parameters("discovery", **others):
        settled()
        robot.publish("/of_the_dead")
        assert "/of_the_dead" in eventually(far.topics, lambda topics: "/of_the_dead" in topics)
        robot.kill("discovery")
        try:
            assert eventually(far.masters, lambda masters: not masters.get(robot.host), seconds).get(robot.host) in (
                False,
                None,
            )
            assert robot.host not in eventually(far.masters, lambda masters: robot.host not in masters, 30)
            assert "/of_the_dead" not in eventually(far.topics, lambda topics: "/of_the_dead" not in topics)
        finally:
            robot.revive("discovery")
        settled()
    settled()
    exchange("after_kill")


def test_a_name_that_both_have_is_refused_and_our_node_survives():
    """Nobody can keep upstream's roscore from ending the node of the same name on its own robot, when it imports ours.

    The other robots take no part: one that imports both names by upstream's master_sync makes its roscore end the first.
    """
    for robot in ROBOTS.values():
        robot.run(f"systemctl stop {robot.unit('sync')}")
    try:
        for robot in (OURS, THEIRS):
            robot.start("twin", f"rostopic pub -r 5 /twin_of_{robot.label} std_msgs/String hello __name:=twin")
        for robot in (OURS, THEIRS):
            nodes = eventually(lambda robot=robot: robot.run("rosnode list").split(), lambda nodes: "/twin" in nodes)
            assert "/twin" in nodes
        OURS.launch("sync")
        log = eventually(lambda: OURS.log("sync", 30), lambda text: "/twin" in text)
        assert re.search(r"the node /twin at \S+ is refused: here it is", log), log
        THEIRS.launch("sync")
        assert "/twin_of_ours" in eventually(THEIRS.topics, lambda topics: "/twin_of_ours" in topics)
        assert THEIRS.hears("/twin_of_ours")
        assert OURS.active("twin")
    finally:
        for robot in (OURS, THEIRS):
            robot.stop("twi*")  # a pattern: it may be gone
        for robot in ROBOTS.values():
            robot.launch("sync")


@both_ways
def test_a_fifth_of_all_packets_is_lost(giver, taker):
    with OURS.losing(20):
        giver.publish("/in_spite_of_losses")
        topics = eventually(taker.topics, lambda topics: "/in_spite_of_losses" in topics, 40)
        assert "/in_spite_of_losses" in topics
        assert all(ROBOTS[host] and online for host, online in taker.masters().items())
        giver.unpublish("/in_spite_of_losses")
        topics = eventually(taker.topics, lambda topics: "/in_spite_of_losses" not in topics, 40)
        assert "/in_spite_of_losses" not in topics
    settled()
