# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Records of a roscore: carried out, made again, told."""

import pytest
from rosfleet_multimaster.roscore.core.registry import Registry, to_feed, touches

A, B = ("/a", "http://robot:1/"), ("/b", "http://robot:2/")
SOME = [
    ["node", *A],
    ["node", *B],
    ["type", "/chatter", "std_msgs/String"],
    ["publisher", "/chatter", *A, True],
    ["publisher", "/chatter", *B, True],
    ["subscriber", "/chatter", *B, True],
    ["listener", "/speed/", *B, True],
    ["service", "/stop", "/a", "rosrpc://robot:3", "http://robot:1/", True],
    ["set", "/speed", 3],
]


def made(*records):
    registry = Registry()
    for record in records:
        registry.apply(record)
    return registry


def same(one, other):
    return vars(one) == vars(other)


def test_its_records_make_the_same_registry():
    registry = made(*SOME)
    assert same(made(*registry.records()), registry)
    assert list(registry.publishers["/chatter"]) == [A, B] and registry.services["/stop"].node == "/a"


def test_what_is_taken_back_is_gone():
    gone = [
        ["publisher", "/chatter", *A, False],
        ["publisher", "/chatter", *B, False],
        ["subscriber", "/chatter", *B, False],
        ["listener", "/speed/", *B, False],
        ["service", "/stop", "/a", "rosrpc://robot:3", "", False],
        ["node", "/a", ""],
        ["node", "/b", ""],
        ["delete", "/speed"],
    ]
    left = made(*SOME, *gone)
    assert not left.nodes and not left.publishers and not left.subscribers and not left.listeners
    assert not left.services and not left.parameters and left.types == {"/chatter": "std_msgs/String"}


def test_a_service_that_another_node_has_by_now_stays():
    taken = ["service", "/stop", "/b", "rosrpc://robot:4", "http://robot:2/", True]
    late = ["service", "/stop", "/a", "rosrpc://robot:3", "", False]
    assert made(*SOME, taken, late).services["/stop"].node == "/b"


def test_nothing_is_registered_twice():
    assert made(*SOME, ["publisher", "/chatter", *A, True]).publishers == {"/chatter": {A: None, B: None}}


@pytest.mark.parametrize(
    ("records", "tree"),
    [
        ([["set", "/a/b", 1], ["set", "/a/c", 2]], {"a": {"b": 1, "c": 2}}),
        ([["set", "/a", 1], ["set", "/a/b", 2]], {"a": {"b": 2}}),
        ([["set", "/a", {"b": 1, "c": 2}], ["delete", "/a/b"]], {"a": {"c": 2}}),
        ([["set", "/a/b", 1], ["delete", "/a/b"]], {"a": {}}),
        ([["set", "/a/b", 1], ["set", "/", {"c": 3}]], {"c": 3}),
        ([["set", "/a", 1], ["delete", "/a/b"], ["delete", "/x/y"], ["delete", "/"]], {"a": 1}),
    ],
)
def test_parameters_are_a_tree_as_in_rosmaster(records, tree):
    assert made(*records).parameters == tree


@pytest.mark.parametrize("record", [[], ["nothing"], ["node"], ["set", "/", 3], ["publisher", "/a"], ["node", [], "x"]])
def test_a_record_that_says_nothing_is_an_error(record):
    with pytest.raises(ValueError, match="no record"):
        made(record)


def test_a_registry_without_some_nodes():
    left = made(*SOME).exclude(lambda name, _uri: name == "/a")
    assert left.publishers == {"/chatter": {B: None}} and not left.services and list(left.nodes) == ["/b"]
    assert left.parameters == {"speed": 3} and left.types


def test_the_feed_has_no_topic_uris_and_few_parameters():
    assert to_feed([["publisher", "/chatter", *A, True]]) == [["publisher", "/chatter", "/a", True]]
    assert to_feed([["service", "/stop", "/a", "rosrpc://robot:3", "", False]]) == [["service", "/stop", "/a", ""]]
    assert to_feed([["set", "/speed", 3], ["listener", "/speed/", *B, True]]) == []
    whole = to_feed([*made(*SOME).records(), ["parameter", "/speed", 3], ["parameter", "/none", None]])
    assert ["parameter", "/speed", 3] in whole and ["parameter", "/none", None] in whole
    assert ["subscriber", "/chatter", "/b", True] in whole and ["node", "/a", "http://robot:1/"] in whole


@pytest.mark.parametrize(
    ("changed", "parameter", "does"),
    [("/", "/a/b", True), ("/a", "/a/b", True), ("/a/b/c", "/a/b", True), ("/ab", "/a/b", False), ("/x", "/a", False)],
)
def test_a_change_above_or_below_touches_a_parameter(changed, parameter, does):
    assert touches(changed, parameter) is does
