# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The exchange between the two implementations: topics, services, actions, in both directions, first come first served."""

import json

import pytest
from fleet import COMPUTERS, DIRECTIONS, OURS, ROBOTS, THEIRS, eventually, other

both_ways = pytest.mark.parametrize(("giver", "taker"), DIRECTIONS, ids=lambda robot: robot.host)


@pytest.fixture(scope="module")
def reached():
    """Every computer's node hears and calls those of all others at once: whom it reached."""
    for own in COMPUTERS:
        others = " ".join(computer.host for computer in COMPUTERS if computer is not own)
        own.start("everybody", f"python3 /opt/nodes/programs/everybody.py {own.host} {others} > /run/everybody")
    try:
        return {
            own.host: json.loads(eventually(lambda own=own: own.run("cat /run/everybody"), bool, 60) or "{}")
            for own in COMPUTERS
        }
    finally:
        for own in COMPUTERS:
            own.stop("everybody")


@pytest.mark.parametrize("own", COMPUTERS, ids=lambda computer: computer.host)
@pytest.mark.parametrize("what", ["topic", "service"])
def test_everybody_reaches_everybody(reached, own, what):
    """Five computers of four robots: bundled, upstream's, and one node of each on one roscore."""
    assert sorted(reached[own.host][what]) == sorted(computer.host for computer in COMPUTERS if computer is not own)


@both_ways
@pytest.mark.parametrize("client", ["rospy", "roscpp"])
@pytest.mark.parametrize("first", ["publisher", "subscriber"])
def test_messages_arrive(giver, taker, client, first):
    topic = f"/{client}_{first}_of_{giver.label}"
    heard = topic if client == "rospy" else f"{topic}_out"
    if first == "publisher":
        giver.publish(topic, client=client)
        assert topic in eventually(taker.topics, lambda topics: topic in topics)
    taker.listen(heard)
    if client == "roscpp":
        taker.start("relay", f"/usr/lib/topic_tools/relay {topic} {heard} __name:={heard[1:]}_relay")
    if first == "subscriber":
        assert heard in eventually(taker.topics, lambda topics: heard in topics)
        giver.publish(topic, client=client)
    assert eventually(taker.heard, bool), f"nothing arrived on {topic}"


@both_ways
def test_a_topic_goes_with_its_publisher(giver, taker):
    giver.publish("/short_lived")
    assert "/short_lived" in eventually(taker.topics, lambda topics: "/short_lived" in topics)
    giver.unpublish("/short_lived")
    assert "/short_lived" not in eventually(taker.topics, lambda topics: "/short_lived" not in topics)


@both_ways
def test_a_service_is_called(giver, taker):
    giver.start("server", "python3 /opt/nodes/programs/service_server.py interop_server")
    assert "/interop_server/where" in eventually(taker.services, lambda names: "/interop_server/where" in names)
    assert giver.host in taker.run("timeout -k 5 20 rosservice call /interop_server/where")
    giver.stop("server")
    assert "/interop_server/where" not in eventually(taker.services, lambda names: "/interop_server/where" not in names)


@both_ways
def test_an_action_gives_feedback_and_its_result(giver, taker):
    giver.start("action", "python3 /opt/nodes/programs/action_server.py interop_action")
    feedbacks, result = taker.run(
        "timeout 85 python3 /opt/nodes/programs/action_client.py /interop_action/double"
    ).split()
    assert int(feedbacks) > 0 and result == "42"


@pytest.mark.parametrize("robot", [OURS, THEIRS], ids=lambda robot: robot.host)
def test_md5_sums_of_the_own_types_are_told(robot):
    """Upstream's master_sync asks for them after each registration."""
    robot.publish(f"/told_by_{robot.label}")
    told = eventually(lambda: robot.ask("getTopicsMd5sum", ["std_msgs/String"]), bool)
    assert told == [["std_msgs/String", "992ce8a1687cec8c8bd883ec73ca41d1"]]


@pytest.mark.parametrize("robot", ROBOTS.values(), ids=lambda robot: robot.host)
def test_a_state_says_whose_its_nodes_are(robot):
    """On a roscore with one node of each, it is learnt by get_sync_info; imports do not move the local stamp."""
    giver, imported, own = other(robot), f"/given_to_{robot.label}", f"/of_{robot.label}"

    def origins():
        return {name: (origin, where) for name, _uri, origin, _pid, where in robot.ask("masterInfo")[8]}

    local_before = robot.ask("masterInfo")[1]
    robot.publish(own)
    nodes = eventually(origins, lambda nodes: f"{own}_source" in nodes)
    assert nodes[f"{own}_source"] == (f"http://{robot.host}:11311/", "local")
    local_after = robot.ask("masterInfo")[1]
    assert local_after != local_before
    giver.publish(imported)
    nodes = eventually(origins, lambda nodes: f"{imported}_source" in nodes)
    assert nodes[f"{imported}_source"] == (f"http://{giver.host}:11311/", "remote")
    stamp, local_stamp = robot.ask("masterInfo")[:2]
    assert local_stamp == local_after and robot.ask("masterContacts")[0] == stamp
