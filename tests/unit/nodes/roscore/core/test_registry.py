# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Records of a roscore: carried out, made again, told."""

import pytest
from rosfleet_multimaster.roscore.core.registry import Record, Registry, to_feed, touches

from tests.unit.nodes.roscore.records import rec

A, B = ("/a", "http://robot:1/"), ("/b", "http://robot:2/")
SOME = [
    rec("node", *A),
    rec("node", *B),
    rec("type", "/chatter", "std_msgs/String"),
    rec("publisher", "/chatter", *A, True),
    rec("publisher", "/chatter", *B, True),
    rec("subscriber", "/chatter", *B, True),
    rec("listener", "/speed/", *B, True),
    rec("service", "/stop", "/a", "rosrpc://robot:3", "http://robot:1/", True),
    rec("set", "/speed", 3),
]


def made(*records):
    registry = Registry()
    for record in records:
        registry.apply(record)
    return registry


def test_its_records_make_the_same_registry():
    registry = made(*SOME)
    assert vars(made(*registry.facts.values(), rec("set", "/", registry.parameters))) == vars(registry)
    assert list(registry.facts.values()) == SOME[:-1] and registry.parameters == {"speed": 3}


def test_what_is_taken_back_is_gone():
    gone = [
        rec("publisher", "/chatter", *A, False),
        rec("publisher", "/chatter", *B, False),
        rec("subscriber", "/chatter", *B, False),
        rec("listener", "/speed/", *B, False),
        rec("service", "/stop", "/a", "rosrpc://robot:3", "", False),
        rec("node", "/a", ""),
        rec("node", "/b", ""),
        rec("delete", "/speed"),
    ]
    left = made(*SOME, *gone)
    assert list(left.facts.values()) == [rec("type", "/chatter", "std_msgs/String")] and not left.parameters
    assert left.values("type") == {"/chatter": "std_msgs/String"} and left.values("node") == {}


def test_a_service_that_another_node_has_by_now_stays():
    taken = rec("service", "/stop", "/b", "rosrpc://robot:4", "http://robot:2/", True)
    late = rec("service", "/stop", "/a", "rosrpc://robot:3", "", False)
    registry = made(*SOME, taken)
    assert registry.is_known(late) and not registry.is_known(SOME[-2])
    registry.apply(late)
    assert [record for record in registry.facts.values() if record[0] == "service"] == [taken]


def test_nothing_is_registered_twice():
    assert vars(made(*SOME, rec("publisher", "/chatter", *A, True))) == vars(made(*SOME))


@pytest.mark.parametrize(
    ("records", "tree"),
    [
        ([rec("set", "/a/b", 1), rec("set", "/a/c", 2)], {"a": {"b": 1, "c": 2}}),
        ([rec("set", "/a", 1), rec("set", "/a/b", 2)], {"a": {"b": 2}}),
        ([rec("set", "/a", {"b": 1, "c": 2}), rec("delete", "/a/b")], {"a": {"c": 2}}),
        ([rec("set", "/a/b", 1), rec("delete", "/a/b")], {"a": {}}),
        ([rec("set", "/a/b", 1), rec("set", "/", {"c": 3})], {"c": 3}),
        ([rec("set", "/a", 1), rec("delete", "/a/b"), rec("delete", "/x/y"), rec("delete", "/")], {"a": 1}),
    ],
)
def test_parameters_are_a_tree_as_in_rosmaster(records, tree):
    assert made(*records).parameters == tree


@pytest.mark.parametrize("record", [[], ["nothing"], ["node"], ["set", "/", 3], ["publisher", "/a"], ["node", [], "x"]])
def test_a_record_that_says_nothing_is_an_error(record):
    with pytest.raises(ValueError, match="no record"):
        made(Record.from_row(record))


def test_a_registry_without_some_nodes():
    left = made(*SOME).exclude(lambda name, _uri: name == "/a")
    assert list(left.facts.values()) == [SOME[at] for at in (1, 2, 4, 5, 6)]
    assert left.parameters == {"speed": 3}


def test_the_feed_has_no_topic_uris_and_few_parameters():
    assert to_feed([rec("publisher", "/chatter", *A, True)]) == [["publisher", "/chatter", "/a", True]]
    assert to_feed([rec("service", "/stop", "/a", "rosrpc://robot:3", "", False)]) == [["service", "/stop", "/a", ""]]
    assert to_feed([rec("set", "/speed", 3), rec("listener", "/speed/", *B, True)]) == []
    whole = to_feed([*SOME, rec("parameter", "/speed", 3), rec("parameter", "/none", None)])
    assert ["parameter", "/speed", 3] in whole and ["parameter", "/none", None] in whole
    assert ["subscriber", "/chatter", "/b", True] in whole and ["node", "/a", "http://robot:1/"] in whole


@pytest.mark.parametrize(
    ("changed", "parameter", "does"),
    [("/", "/a/b", True), ("/a", "/a/b", True), ("/a/b/c", "/a/b", True), ("/ab", "/a/b", False), ("/x", "/a", False)],
)
def test_a_change_above_or_below_touches_a_parameter(changed, parameter, does):
    assert touches(changed, parameter) is does
