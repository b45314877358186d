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


def test_its_records_make_the_same_registry():
    registry = made(*SOME)
    assert vars(made(*registry.facts.values(), ["set", "/", registry.parameters])) == vars(registry)
    assert list(registry.facts.values()) == SOME[:-1] and registry.parameters == {"speed": 3}


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
    assert list(left.facts.values()) == [["type", "/chatter", "std_msgs/String"]] and not left.parameters
    assert left.values("type") == {"/chatter": "std_msgs/String"} and left.values("node") == {}


def test_a_service_that_another_node_has_by_now_stays():
    taken = ["service", "/stop", "/b", "rosrpc://robot:4", "http://robot:2/", True]
    late = ["service", "/stop", "/a", "rosrpc://robot:3", "", False]
    registry = made(*SOME, taken)
    assert registry.is_known(late) and not registry.is_known(SOME[-2])
    registry.apply(late)
    assert [record for record in registry.facts.values() if record[0] == "service"] == [taken]


def test_nothing_is_registered_twice():
    assert vars(made(*SOME, ["publisher", "/chatter", *A, True])) == vars(made(*SOME))


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
    assert list(left.facts.values()) == [SOME[at] for at in (1, 2, 4, 5, 6)]
    assert left.parameters == {"speed": 3}


def test_the_feed_has_no_topic_uris_and_few_parameters():
    assert to_feed([["publisher", "/chatter", *A, True]]) == [["publisher", "/chatter", "/a", True]]
    assert to_feed([["service", "/stop", "/a", "rosrpc://robot:3", "", False]]) == [["service", "/stop", "/a", ""]]
    assert to_feed([["set", "/speed", 3], ["listener", "/speed/", *B, True]]) == []
    whole = to_feed([*SOME, ["parameter", "/speed", 3], ["parameter", "/none", None]])
    assert ["parameter", "/speed", 3] in whole and ["parameter", "/none", None] in whole
    assert ["subscriber", "/chatter", "/b", True] in whole and ["node", "/a", "http://robot:1/"] in whole


@pytest.mark.parametrize(
    ("changed", "parameter", "does"),
    [("/", "/a/b", True), ("/a", "/a/b", True), ("/a/b/c", "/a/b", True), ("/ab", "/a/b", False), ("/x", "/a", False)],
)
def test_a_change_above_or_below_touches_a_parameter(changed, parameter, does):
    assert touches(changed, parameter) is does
