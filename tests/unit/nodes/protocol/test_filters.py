# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
import re
import sys

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rosfleet_multimaster.protocol.filters import NOTHING, WHITE_LISTS, Filters, InvalidPattern, Pattern
from rosfleet_multimaster.protocol.wire_filters import read_pattern, read_rules, write_rules

names = st.from_regex(r"(/[a-z][a-z0-9_]{0,8}){1,3}", fullmatch=True)


def rules(**values):
    return Filters(values).rules("other")


@pytest.mark.parametrize(
    ("pattern", "name", "matches"),
    [
        ("/tf", "/tf", True),
        ("/tf", "/tf_static", False),
        ("/tf*", "/tf_static", True),
        ("/TF", "/tf", True),
        ("/a.b", "/axb", True),
        ("/tf.*", "/tf", False),  # upstream's: every * becomes "any characters", so .* wants one
        ("/a|/b", "/a_longer", False),
        ("/a|/b", "/b", True),
        (" /tf ", "/tf", True),
    ],
)
def test_patterns(pattern, name, matches):
    assert Pattern.from_items([pattern]).matches(name) is matches


@given(st.text(max_size=5))
def test_nothing_matches_nothing(name):
    assert NOTHING and not NOTHING.matches(name) and read_pattern(NOTHING.text) == NOTHING


@given(st.lists(names, max_size=5), names)
def test_a_list_of_names_matches_exactly_these_names(items, name):
    assert Pattern.from_items(items).matches(name) == (name in items)


@given(st.text(max_size=30))
def test_any_text_is_a_pattern_or_refused(text):
    for make in (lambda: Pattern.from_items([text]), lambda: read_pattern(text)):
        try:
            make().matches("/chatter")
        except InvalidPattern as problem:
            assert str(problem)


@pytest.mark.parametrize(
    "values",
    [
        {"ignore_topics": ["/a", "(?a)(?u)/b"]},
        {"ignore_topics": ["(?P<n>a)", "(?P<n>b)"]},
        {"ignore_topics": ["(?P<n>a)", {"robot2": ["(?P<n>b)"]}]},
    ],
)
def test_patterns_that_are_wrong_together_are_refused_at_start(values):
    with pytest.raises(InvalidPattern, match="ignore_topics"):
        Filters(values).check()


@pytest.mark.skipif(sys.version_info < (3, 11), reason="older Pythons accept it")
def test_a_flag_in_the_middle_is_refused_at_the_start():
    with pytest.raises(InvalidPattern, match="in its anchors"):
        Filters({"ignore_topics": ["(?i)/a"]}).check()


@pytest.mark.parametrize("name", ["/x ", "/x\n", "/" + "x" * 70000, "", "*", "(", "/a*"])
def test_what_another_master_calls_its_discovery_is_no_pattern(name):
    found = Filters({}).rules("other", (name, "/own_sync"))
    assert found.topic("/talker", "/chatter", "std_msgs/String", True)
    assert not found.topic("/own_sync", "/chatter", "std_msgs/String", True)


def test_a_name_that_is_too_long_is_not_exchanged():
    assert not rules().topic("/n", "/" + "a" * 255, "t", True)
    assert not rules().service("/n", "/" + "a" * 255)
    assert rules().topic("/n", "/" + "a" * 254, "t", True)


def test_all_but_the_exchange_itself_is_exchanged_by_default():
    default = rules()
    assert default.topic("/talker", "/chatter", "std_msgs/String", True)
    assert default.service("/adder", "/add")
    assert not default.topic("/rosout", "/rosout_agg", "rosgraph_msgs/Log", True)
    assert not default.topic("/talker", "/rosout", "rosgraph_msgs/Log", True)
    assert not default.topic("/x", "/master_discovery/changes", "fkie_multimaster_msgs/MasterState", True)
    assert not default.service("/talker", "/talker/get_loggers")
    assert not default.topic("/n", "/bond", "bond/Status", True)


@pytest.mark.parametrize("service", ["run", "start_launch", "load_launch", "list_nodes", "get_loggers"])
@pytest.mark.parametrize("node", ["/mas_daemon", "/anything"])
def test_no_start_button_of_a_stranger_is_exchanged(service, node):
    assert not rules().service(node, f"/mas_daemon/{service}")
    assert not Filters({"sync_services": ["*"]}).rules("other").service(node, f"/mas_daemon/{service}")


def test_the_exchange_of_the_successor_is_not_exchanged():
    default = rules()
    for node in ("/mas_discovery", "/mas_sync", "/mas_daemon", "/mas_zeroconf", "/mas_subscriber/odom"):
        assert not default.topic(node, "/diagnostics", "diagnostic_msgs/DiagnosticArray", True)
        assert not default.service(node, "/x")
    for service in ("/mas_sync/get_sync_info", "/mas_discovery/list_masters", "/mas_discovery/refresh"):
        assert not default.service("/x", service)
    assert not default.topic("/x", "/mas_discovery/changes", "x/Y", True)
    assert not default.topic("/x", "/changes", "fkie_mas_msgs/MasterState", True)
    assert default.topic("/mas", "/mas_discovery_of_mine", "std_msgs/String", True)
    assert default.service("/mas_daemon_of_mine", "/mas_daemons/run")


@pytest.mark.parametrize(
    ("values", "topic", "wanted"),
    [
        ({"sync_topics": ["/a"]}, "/a", True),
        ({"sync_topics": ["/a"]}, "/b", False),
        ({"sync_topics": ["/a"], "ignore_topics": ["/a"]}, "/a", False),
        ({"sync_nodes": ["/n"]}, "/b", True),
        ({"sync_nodes": ["/other"]}, "/b", False),
        ({"ignore_nodes": ["/n"], "sync_topics": ["/a"]}, "/a", False),
        ({"ignore_publishers": ["/a"]}, "/a", False),
        ({"ignore_subscribers": ["/a"]}, "/a", True),
        ({"ignore_type": ["std_msgs/*"]}, "/a", False),
        ({"do_not_sync": ["/n"]}, "/a", False),
        ({"ignore_topics": "/a"}, "/a", False),
    ],
)
def test_topics(values, topic, wanted):
    assert rules(**values).topic("/n", topic, "std_msgs/String", True) is wanted


@pytest.mark.parametrize(
    ("values", "topic", "service"),
    [
        ({}, True, True),
        ({"sync_topics": ["/a"]}, True, False),
        ({"sync_topics": ["/b"]}, False, False),
        ({"sync_services": ["/s"]}, False, True),
        ({"sync_services": ["/t"]}, False, False),
        ({"sync_topics": ["/a"], "sync_services": ["/s"]}, True, True),
        ({"sync_nodes": ["/n"]}, True, True),
        ({"sync_nodes": ["/m"]}, False, False),
        ({"sync_nodes": ["/m"], "sync_topics": ["/a"]}, True, False),
        ({"sync_topics": [{"robot9": ["/a"]}]}, True, True),  # a white list for somebody else
        ({"sync_topics": ["/a"], "ignore_nodes": ["/n"]}, False, False),
        ({"ignore_topics": ["/a"]}, False, True),
    ],
)
def test_a_white_list_restricts_topics_and_services(values, topic, service):
    found = rules(**values)
    assert found.topic("/n", "/a", "std_msgs/String", True) is topic
    assert found.service("/n", "/s") is service


def upstream_server(wire, names, kind):
    """Upstream's masterInfoFiltered, written down from its description: "" is "no list"."""
    _remote, _ignore_nodes, sync_nodes, _ignored, sync_topics, _ignored, sync_services, *_rest = wire
    lists = [sync_nodes, sync_topics if kind == "topic" else sync_services]
    hits = [text and re.match(text, name, re.IGNORECASE) for text, name in zip(lists, names)]
    return bool(any(hits) or not any(lists))


@given(
    st.fixed_dictionaries({name: st.lists(st.sampled_from(["/a", "/b*"]), max_size=1) for name in WHITE_LISTS}),
    names,
    names,
)
def test_an_upstream_server_applies_white_lists_the_same_way(values, node, name):
    found = rules(**values)
    wire = write_rules(found, False)
    assert upstream_server(wire, (node, name), "topic") == found.topic(node, name, "std_msgs/String", True)
    assert upstream_server(wire, (node, name), "service") == found.service(node, name)
    assert read_rules(wire) == found


@pytest.mark.parametrize(
    ("values", "host", "wanted"),
    [
        ({}, "a", True),
        ({"sync_hosts": ["a"]}, "a", True),
        ({"sync_hosts": ["a"]}, "b", False),
        ({"ignore_hosts": ["a"]}, "a", False),
        ({"ignore_hosts": ["a"], "sync_hosts": ["c"]}, "b", False),
        ({"ignore_hosts": ["a"], "sync_hosts": ["c"]}, "c", True),
        ({"ignore_hosts": ["c"], "sync_hosts": ["c"]}, "c", True),
        ({"ignore_hosts": ["A"]}, "a", False),
        ({"sync_hosts": ["Robot_2"]}, "robot_2", True),
        ({"ignore_hosts": ["*"], "sync_hosts": ["c"]}, "b", False),
        ({"ignore_hosts": ["*"], "sync_hosts": ["c"]}, "c", True),
    ],
)
def test_hosts(values, host, wanted):
    assert Filters(values).wants_host(host) is wanted


@pytest.mark.parametrize(
    "values",
    [
        {"ignore_topics": [{"Robot1": ["/a"]}]},
        {"ignore_topics": {"ROBOT1": "/a"}},
        {"robot1": {"ignore_topics": ["/a"]}},
    ],
)
def test_filters_of_one_host_whatever_its_case(values):
    assert not Filters(values).rules("robot1").topic("/n", "/a", "t", True)
    assert Filters(values).rules("robot2").topic("/n", "/a", "t", True)


@pytest.mark.parametrize(
    "values",
    [
        {"ignore_topics": ["/a["]},
        {"sync_hosts": ["("]},
        {"x": {"ignore_nodes": ["[b"]}},
        {"ignore_nodes": [7]},
        {"ignore_nodes": 7},
    ],
)
def test_an_invalid_pattern_is_named(values):
    with pytest.raises(InvalidPattern, match="_"):
        Filters(values).check()


def test_a_name_that_no_pattern_matches_is_ignored_too():
    assert not Filters({"ignore_hosts": ["*"]}).wants_host("r" * 256)
