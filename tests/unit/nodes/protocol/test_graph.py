# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
import copy

import pytest
from rosfleet_multimaster.protocol.filters import Filters, Rules
from rosfleet_multimaster.protocol.graph import State, add_stamps, build, document, graph_of, parse

URI = "http://kobuki1computer:11311/"
OTHER = "http://kobuki2computer:11311/"
SYSTEM = [
    [["/chatter", ["/talker", "/far"]], ["/rosout", ["/talker"]]],
    [["/chatter", ["/listener"]], ["/unknown", ["/listener"]]],
    [["/add", ["/adder"]], ["/talker/get_loggers", ["/talker"]]],
]
TYPES = [["/chatter", "std_msgs/String"], ["/rosout", "rosgraph_msgs/Log"], ["/unknown", "*"]]
NODES = {name: f"http://kobuki1computer:{40000 + at}/" for at, name in enumerate(["/talker", "/listener", "/adder"])}
NODES["/far"] = "http://kobuki2computer:40000/"
SERVICES = {"/add": "rosrpc://kobuki1second:5000", "/talker/get_loggers": "rosrpc://kobuki1computer:5001"}
ORIGINS = {("/far", NODES["/far"]): OTHER}


def state(system=None, types=None, nodes=None, origins=None):
    graph = graph_of(
        State(URI, "kobuki1computer"), SYSTEM if system is None else system, TYPES if types is None else types
    )
    nodes, origins = NODES if nodes is None else nodes, ORIGINS if origins is None else origins
    return build(graph, nodes, SERVICES, origins)


def test_the_document_has_the_shape_of_the_interface():
    value = document(add_stamps(state(), None, 1700000000.25))
    assert value[:4] == ["1700000000.250000000", "1700000000.250000000", URI, "kobuki1computer"]
    assert value[4] == [["/chatter", ["/far", "/talker"]], ["/rosout", ["/talker"]]]
    assert value[5] == [["/chatter", ["/listener"]], ["/unknown", ["/listener"]]]
    assert value[6] == [["/add", ["/adder"]], ["/talker/get_loggers", ["/talker"]]]
    assert value[7] == [["/chatter", "std_msgs/String"], ["/rosout", "rosgraph_msgs/Log"], ["/unknown", "*"]]
    assert ["/far", NODES["/far"], OTHER, None, "remote"] in value[8]
    assert ["/talker", NODES["/talker"], URI, None, "local"] in value[8]
    assert value[9] == [
        ["/add", "rosrpc://kobuki1second:5000", URI, "", "local"],
        ["/talker/get_loggers", "rosrpc://kobuki1computer:5001", URI, "", "local"],
    ]


def test_locality_is_decided_by_origin_and_not_by_the_host():
    nodes = {**NODES, "/adder": "http://192.168.11.5:1234/", "/listener": "http://elsewhere:1/"}
    found = state(nodes=nodes).nodes
    assert {name: node.locality for name, node in found.items()} == {
        "/talker": "local",
        "/listener": "local",
        "/adder": "local",
        "/far": "remote",
    }


def test_a_node_that_came_back_with_another_uri_is_not_imported():
    assert state(nodes={**NODES, "/far": "http://kobuki1computer:9/"}).nodes["/far"].locality == "local"


def test_the_document_comes_back():
    sent = add_stamps(state(), None, 1700000000.123456)
    assert parse(document(sent)) == sent


@pytest.mark.parametrize(
    "name", ["/chatter \x1b[2J", "/two words", "/caf\u00e9", "/x\u202e", "chatter", "/" + "x" * 255]
)
def test_a_name_with_invisible_characters_is_left_out(name):
    value = document(add_stamps(state(), None, 1700000000.25))
    for at, entry in ((4, [name, ["/talker"]]), (5, [name, ["/listener"]]), (7, [name, "x/Y"])):
        value[at] = [*value[at], entry]
    value[8] = [*value[8], [name, "http://kobuki1computer:40009/", URI, None, "local"]]
    value[9] = [*value[9], [name, "rosrpc://kobuki1computer:5009", URI, "", "local"]]
    assert parse(value) == add_stamps(state(), None, 1700000000.25)


def test_filters_leave_out_and_nodes_follow():
    value = document(state(), [Filters({}).rules("x"), Rules()])
    assert [topic for topic, _nodes in value[4]] == ["/chatter"]
    assert [service for service, _nodes in value[6]] == ["/add"]
    assert "/rosout" not in [topic for topic, _type in value[7]]
    only = document(state(), [Filters({"ignore_nodes": ["/adder", "/listener", "/far"]}).rules("x")])
    assert [node[0] for node in only[8]] == ["/talker"]
    assert only[9] == []


def test_stamps_move_with_what_changes():
    first = add_stamps(state(), None, 100.0)
    assert add_stamps(state(), first, 200.0) is first
    less = copy.deepcopy(SYSTEM)
    less[0][0][1] = ["/talker"]
    imported = add_stamps(state(less), first, 200.0)
    assert (imported.stamp, imported.local_stamp) == (200.0, 100.0)
    less[0][0][1] = ["/far"]
    own = add_stamps(state(less), imported, 300.0)
    assert (own.stamp, own.local_stamp) == (300.0, 300.0)
    typed = add_stamps(state(less, [["/chatter", "std_msgs/Bool"]]), own, 400.0)
    assert typed.stamp == 400.0


def test_a_clock_that_steps_to_the_old_stamp_still_changes_it():
    first = add_stamps(state(), None, 100.0)
    second = add_stamps(state([[], [], []]), first, 100.0)
    assert second.stamp != first.stamp


@pytest.mark.parametrize("uri", [None, 5, "file:///etc/passwd", "rosrpc://x"])
def test_an_unusable_node_uri_is_none(uri):
    value = document(state())
    value[8][0][1] = uri
    assert parse(value).nodes[value[8][0][0]].uri is None
