# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
import re
import sys
import time
from functools import partial

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rosfleet_multimaster.protocol.filters import (
    MAX_STARRED,
    MAX_TEXT,
    NO_NAME,
    NOTHING,
    WHITE_LISTS,
    Filters,
    InvalidPattern,
    Pattern,
    secret_names,
)
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
    assert (
        NOTHING and not NOTHING.matches(name) and not NOTHING.matches(NO_NAME) and read_pattern(r"\A(?!)\Z") == NOTHING
    )


@given(st.lists(names, max_size=5), names)
def test_a_list_of_names_matches_exactly_these_names(items, name):
    assert Pattern.from_items(items).matches(name) == (name in items)


@given(st.text(max_size=30))
def test_any_text_is_a_pattern_or_refused(text):
    for make in (Pattern.from_items, partial(Pattern.from_foreign_items, what="it"), secret_names):
        try:
            make([text]).matches("/chatter")
        except InvalidPattern as problem:
            assert str(problem)


@given(st.lists(st.sampled_from(["", "a", "b", "ab", "aba", "/"]), min_size=1, max_size=6), st.text("ab/", max_size=12))
def test_names_with_stars_match_as_the_expressions_do(parts, name):
    meant = re.fullmatch(".*".join(parts), name) is not None
    assert Pattern(("*".join(parts),)).matches(name) is meant


@pytest.mark.parametrize(
    "costly",
    [
        r"(?:(?:){65000}){65000}x",
        r"(a+)+b",
        r"(a|b.*)+c",
        r"(.*a){20}",
        r"[ab]*[ab]*[ab]*[ab]*x",
        r"(a{0,16}){0,16}b",
        "a?" * 40 + "b",
        "(?:ab|a|b)" * 40 + "c",
        r"(ab|a)+c",
        r"(?:(?:a{1000}){1000}){1000}b",
        r"(?=(a+)+b)",
        "/(front|rear)_(left|right)/*/*/camera_[0-9]+/*",
    ],
)
def test_costly_expressions_are_refused_at_the_start(costly):
    with pytest.raises(InvalidPattern, match="ignore_topics: the pattern .* would be too costly"):
        Filters({"ignore_topics": [costly]}).check()


@pytest.mark.parametrize("text", [r"/(a)\1", "/(?P<n>a)", "/(?P<m>a)(?(m)b|c)", "/a[", "(?i)/a", "/a{99999999999}"])
def test_expressions_that_would_spoil_the_whole_list_are_refused(text):
    if text == "(?i)/a" and sys.version_info < (3, 11):
        pytest.skip("older Pythons accept it")
    with pytest.raises(InvalidPattern, match="ignore_topics: the pattern .* is no regular expression: "):
        Filters({"ignore_topics": ["/b", "/(?P<n>b)", text]}).check()


@pytest.mark.parametrize(
    "text", ["/cam[0-9]?/(left|right)/*", "/(front|rear)_(left|right)/camera_[0-9]+/*", "a{255}b?"]
)
def test_ordinary_expressions_are_not_costly(text):
    assert Pattern.from_items([text])


@pytest.mark.parametrize(
    "text",
    [".*.*.*x", "[ab]*[ab]*[ab]*x", "(?:a?){6}" + "x", "(?:a|ab){20}x", "(?:a{0,9}){0,3}x", "((a|b){2}|(a|c){3})*x"],
)
def test_the_worst_expression_that_is_accepted_ends(text):
    try:
        pattern = Pattern.from_items([text])
    except InvalidPattern:
        return
    started = time.thread_time()
    for name in ("/" + "a" * 254, "ab" * 127, "a" * 255):
        pattern.matches(name)
    assert time.thread_time() - started < 2


@pytest.mark.parametrize(
    "names", [["a*" * 127 + "b"], ["*a" * 127 + "*b"] * 64, ["*" + "a" * 60 + "b" + "a" * 60 + "*"] * 130]
)
def test_names_with_any_number_of_stars_cost_little(names):
    """Regular expressions of them would take longer than the universe."""
    pattern = Pattern.from_foreign_items(names, "/do_not_sync")
    started = time.thread_time()
    for name in ("/" + "a" * 254, "ab" * 127):
        pattern.matches(name)
    assert time.thread_time() - started < 0.1


@pytest.mark.parametrize(
    "value",
    [
        r"(?:(?:){65000}){65000}x",
        ["/a", "/b.*"],
        [7],
        {"a": "b"},
        ["/" + "a" * MAX_TEXT],
        [""] * (MAX_TEXT + 1),
        ["/a*"] * (MAX_STARRED // 3 + 1),
        1.5,
    ],
)
def test_secret_names_are_names_or_refused_in_few_words(value):
    with pytest.raises(InvalidPattern, match="/do_not_sync") as refused:
        secret_names(value)
    assert len(str(refused.value)) < 400


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
