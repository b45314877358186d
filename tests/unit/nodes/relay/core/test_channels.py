# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Channels: which names cross, by which names, and what is offered."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rosfleet_multimaster.protocol.filters import Pattern
from rosfleet_multimaster.relay.core.channels import (
    MOST_OF_ALL,
    SERVICE,
    TOPIC,
    Channel,
    Offer,
    OwnNodes,
    find_taken,
    list_offers,
    list_own,
    read_offers,
)
from rosfleet_multimaster.relay.core.frames import Frames


def channel(inner, namespace="/kobuki1", topics=("/scan", "/camera/*")):
    return Channel(
        *("other", ("10.0.0.1",), 11911, Pattern.from_items(topics), Pattern.from_items(["/reset"])),
        *(Pattern.from_items(["/cmd_vel"]), namespace, inner),
    )


def ways(one, kind, name):
    """The names of a robot at its relay: as a giver and as a taker."""
    return one.find_local(kind, name, given=True), one.find_local(kind, name, given=False)


def test_names_are_inner_ones_on_the_robot_alone():
    robot, station = channel(True), channel(False)
    for inner in ("/scan", "/camera/image_raw"):
        outer = "/kobuki1" + inner
        assert robot.find_name(TOPIC, inner) == outer and ways(robot, TOPIC, outer) == (inner, None)
        assert station.find_name(TOPIC, outer) is None and ways(station, TOPIC, outer) == (None, outer)
    for other in ("/odom", "/kobuki2/scan", "/kobuki1", "/kobuki1scan"):
        assert station.find_name(TOPIC, other) is None
        assert ways(robot, TOPIC, other) == ways(station, TOPIC, other) == (None, None)
    assert robot.find_name(TOPIC, "/kobuki1/scan") is None


def test_what_comes_back_goes_the_other_way_alone():
    robot, station = channel(True), channel(False)
    assert (
        station.find_name(TOPIC, "/kobuki1/cmd_vel") == "/kobuki1/cmd_vel"
        and robot.find_name(TOPIC, "/cmd_vel") is None
    )
    assert ways(robot, TOPIC, "/kobuki1/cmd_vel") == (None, "/cmd_vel")
    assert ways(station, TOPIC, "/kobuki1/cmd_vel") == ("/kobuki1/cmd_vel", None)
    assert ways(robot, SERVICE, "/kobuki1/cmd_vel") == ways(station, SERVICE, "/kobuki1/cmd_vel") == (None, None)


def test_without_a_namespace_the_names_are_the_same():
    same = channel(True, namespace="")
    assert same.find_name(TOPIC, "/scan") == "/scan" and ways(same, TOPIC, "/scan") == ("/scan", None)
    assert same.find_name(TOPIC, "/odom") is None


def test_services_have_names_of_their_own():
    robot, station = channel(True), channel(False)
    assert robot.find_name(SERVICE, "/reset") == "/kobuki1/reset" and robot.find_name(TOPIC, "/reset") is None
    assert ways(robot, SERVICE, "/kobuki1/reset") == ("/reset", None)
    assert ways(station, SERVICE, "/kobuki1/reset") == (None, "/kobuki1/reset"), "its robot calls it"
    assert ways(robot, SERVICE, "/kobuki1/scan") == (None, None)


def test_what_the_relay_and_other_robots_have_is_not_offered():
    publishers = {"/scan": ("/laser", "/master_relay", "/foreign", "/unrecorded"), "/odom": ("/master_relay",)}
    provided = {"/reset": ("/laser",), "/foreign/reset": ("/foreign",)}
    types = {"/scan": "sensor_msgs/LaserScan"}
    uris = {"/foreign": "http://kobuki1-pc:1/", "/unrecorded": "http://Station-PC:2/", "/laser": "http://Kobuki1-PC:3/"}
    ours = OwnNodes({"kobuki1-pc"}, {("/foreign", "http://kobuki1-pc:1/")})
    topics, services = (list_own(table, uris, "/master_relay", ours) for table in (publishers, provided))
    assert topics == {"/scan": ("/laser",)} and services == {"/reset": ("/laser",)}
    offers = list_offers([channel(True)], topics, services, types, "/master_relay")
    scan = Offer(TOPIC, "/kobuki1/scan", "sensor_msgs/LaserScan", ("/laser",))
    reset = Offer(SERVICE, "/kobuki1/reset", "", ("/laser",))
    assert offers == [reset, scan]
    read = read_offers([[*offer[:3], list(offer.nodes)] for offer in offers])
    station = channel(False)
    taken = {(TOPIC, scan.name): (scan, station), (SERVICE, reset.name): (reset, station)}
    assert find_taken([station], read) == taken


@pytest.mark.parametrize(
    "uri",
    [
        *("http://10.0.0.9:1/", "http://167772161:1/", "http://10.1:1/", "http://0xa.1:1/", "http://012.0.0.1:1/"),
        *(
            "http://[::ffff:10.0.0.1]:1/",
            "http://10.0.0.1.:1/",
            "http://pc.:1/",
            "http://pc@10.0.0.9:1/",
            "http://[pc]:1/",
        ),
        *("http://10.0.0.1:1/x", "http://10.0.0.9\\@10.0.0.1:1/", "http://\uff11\uff10.0.0.1:1/", "http:///", "x", ""),
    ],
)
def test_only_a_planned_host_in_its_own_spelling_is_own(uri):
    ours = OwnNodes({"pc", "10.0.0.1"})
    assert not list_own({"/scan": ["/laser"]}, {"/laser": uri}, "/master_relay", ours)
    assert not list_own({"/scan": ["/laser"]}, {}, "/master_relay", ours)
    for own in ("http://10.0.0.1:1/", "http://PC:1", "rosrpc://pc:1"):
        assert list_own({"/scan": ["/laser"]}, {"/laser": own}, "/master_relay", ours) == {"/scan": ("/laser",)}


@pytest.mark.parametrize("others", [(), ("/fixed",), tuple(f"/n{number}" for number in range(50))])
def test_the_root_of_the_frames_is_one_more_publisher(others):
    frames = Frames(b"kobuki1/", b"world", b"map")
    robot = channel(True, "", ("/tf", "/tf_static"))._replace(frames=frames)
    topics = {"/tf_static": others} if others else {}
    (offer,) = list_offers([robot], topics, {}, {"/tf_static": "tf2_msgs/TFMessage"}, "/master_relay")
    assert offer[:3] == (TOPIC, "/tf_static", "tf2_msgs/TFMessage") and offer.nodes == (*others[:49], "/master_relay")
    assert read_offers([[*offer[:3], list(offer.nodes)]]) == [offer]
    for without in (robot._replace(inner=False), robot._replace(frames=Frames(b"kobuki1/")), channel(True)):
        assert not list_offers([without], {}, {}, {}, "/master_relay")


@pytest.mark.parametrize(
    "wrong",
    [
        *(None, {}, [1], [["topic", "/scan", "x"]], [["topic", "/scan", "x", "y"]], [["topic", "/scan", 1, []]]),
        *([["topic", "", "x", []]], [["topic", "/s", "x", [1]]], [["topic", "/" + "s" * 300, "x", []]]),
        *([["node", "/s", "x", []]], [["topic", "/s", "x", ["/n"] * 60]], [["topic", "/s", "x", []]] * 1001),
        [["service", "/s", "", [""]]],
    ],
)
def test_wrong_offers_are_refused(wrong):
    with pytest.raises(ValueError):
        read_offers(wrong)


@pytest.mark.parametrize("odd", ["scan", "/a b", "/a\tb", "/a\n", "/\x1b[2J", "/\u202escan", "/\ud800"])
def test_an_odd_name_is_left_out_as_the_sync_node_does(odd):
    good = ["topic", "/kobuki1/scan", "sensor_msgs/LaserScan", ["/laser", odd]]
    offers = [
        ["topic", odd, "x/Y", ["/n"]],
        ["topic", "/kobuki1/odom", f"x{odd[1:]} Y", []],
        ["service", odd, "", []],
        good,
    ]
    assert read_offers(offers) == [Offer(TOPIC, "/kobuki1/scan", "sensor_msgs/LaserScan", ("/laser",))]


_texts = st.one_of(st.text(max_size=8), st.sampled_from([TOPIC, SERVICE, "/kobuki1/scan", "x/Y"]))


@given(st.lists(st.tuples(_texts, _texts, _texts, st.lists(_texts, max_size=2)).map(list), max_size=3))
def test_what_is_read_of_any_offers_is_visible(value):
    try:
        offers = read_offers(value)
    except ValueError:
        return
    for offer in offers:
        texts = (offer.name, offer.type, *offer.nodes)
        assert all(text.isascii() and (text + "x").isprintable() and " " not in text for text in texts)
        assert all(text.startswith("/") for text in (offer.name, *offer.nodes))


def test_nodes_of_all_offers_have_a_bound_and_no_topic_is_lost():
    """A peer with 1,000 topics of 17 nodes each took 13 MB."""
    offers = [[TOPIC, f"/p/t{number}", "x/Y", [f"/n{node}" for node in range(17)]] for number in range(999)]
    offers.append([TOPIC, "/p/tf", "x/Y", [f"/n{node}" for node in range(50)]])
    read = read_offers(offers)
    assert len(read) == 1000 and sum(len(offer.nodes) for offer in read) <= MOST_OF_ALL
    few = read_offers([*[offer[:3] + [offer[3][:1]] for offer in offers[:900]], offers[-1]])
    assert len(few[-1].nodes) == 50, "who has few keeps all"


def test_many_peers_share_what_is_taken_of_all():
    offers = [[TOPIC, f"/topic{number}", "x/Y", [f"/node{at}" for at in range(50)]] for number in range(100)]
    taken = [sum(len(offer.nodes) for offer in read_offers(offers, peers)) for peers in (1, 20, 100, 1000)]
    assert taken == [2000, 2000, 400, 100], "no topic is lost"
