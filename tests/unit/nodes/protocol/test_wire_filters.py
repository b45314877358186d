# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
import re
import time

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rosfleet_multimaster.protocol.filters import MAX_TEXT, NAMES, Filters, InvalidPattern, Pattern, Rules
from rosfleet_multimaster.protocol.wire_filters import read_pattern, read_rules, write_rules


@pytest.mark.parametrize(
    "text",
    [
        r"(?:(?:){65000}){65000}x",
        r"\A(?:(?:){65000}){65000}x\Z",
        r"(a+)+b",
        r"\A/a[0-9]\Z",
        r"\A/a..*\Z",
        r"\A/a.*?\Z",
        r"\A/a*\Z",
        r"\A/a\.b\Z",
        r"\A/a\Z|",
        r"\A\Z",
        r"\A(?:/a|/b)\Z",
        r"\A/a|/b\Z",
        r"\A(?!x|\A/a\Z|y).*\Z",
        r"\A/a\\Z",
        r"\A/a\$",
        "/a",
        "(?i)\\A/a\\Z",
        "\\A/" + "a" * MAX_TEXT + "\\Z",
        "[\\0-\\U0010ffff]",
    ],
)
def test_expressions_of_others_are_no_filter(text):
    assert read_pattern(text) is None
    wire = [False, "", "", text, r"\A/b\Z", *[""] * 6]
    assert read_rules(wire) == Rules(sync_topics=Pattern(("/b",)))
    assert read_rules([False, r"\A/n\Z", "", "", r"\A/b\Z", "", text, *[""] * 4]) == Rules(
        ignore_nodes=Pattern(("/n",))
    )


@pytest.mark.parametrize(
    ("text", "items"),
    [
        ("", ()),
        (r"\A/tf\Z", ("/tf",)),
        (r"\A/tf.*\Z|\A/a\Z|\A.*\Z", ("/tf*", "/a", "*")),
        (r"\A/.*get_loggers\Z", ("/*get_loggers",)),
        (r"^/tf$", ("/tf",)),
        (r"\A(?!)\Z", ("(?!)",)),
        (r"\A(?!)\Z|\Astd_msgs/.*\Z", ("(?!)", "std_msgs/*")),
    ],
)
def test_what_upstream_makes_of_names_is_read(text, items):
    assert read_pattern(text) == Pattern(items)


@given(st.lists(st.text("/ab_*~-: Z", min_size=1).filter(str.strip).map(str.strip), max_size=5))
def test_names_travel_as_they_are(items):
    sent = Rules(ignore_topics=Pattern(tuple(items)))
    assert read_rules(write_rules(sent, False)) == sent


@given(st.text("\\AZ^$./ab*|(?!)", max_size=24), st.sampled_from(["", "/", "/a", "/b", "/ab", "/aab", "a", "b/a"]))
def test_what_is_read_means_what_upstream_reads(text, name):
    pattern = read_pattern(text)
    if pattern:
        assert pattern.matches(name) is (re.match(text, name, re.IGNORECASE) is not None)


def test_the_longest_filter_is_read_in_no_time():
    started = time.thread_time()
    for text in (
        "|" * MAX_TEXT,
        r"\A" * (MAX_TEXT // 2),
        r"\A.*\Z|" * (MAX_TEXT // 7),
        "(" * MAX_TEXT,
        ".*" * (MAX_TEXT // 2),
    ):
        read_rules([False, *[text] * 10])
    assert time.thread_time() - started < 2


def test_the_wire_carries_the_rules():
    sent = Filters({"ignore_topics": ["/a*"], "do_not_sync": ["/secret"]}).rules("other")
    wire = write_rules(sent, True)
    assert len(wire) == 1 + len(NAMES) == 11
    assert wire[0] is True
    assert read_rules(wire) == sent
    assert read_rules(wire[:8]).do_not_sync == Pattern()


@pytest.mark.parametrize(
    "value",
    [
        None,
        "x",
        [],
        [False] * 7,
        [False] * 12,
        [False, 1, 2, 3, 4, 5, 6, 7],
        [False, None] + [""] * 6,
    ],
)
def test_what_is_no_filter_is_refused(value):
    with pytest.raises(InvalidPattern):
        read_rules(value)


EXPRESSION = "/(front|rear)_(left|right)/camera_[0-9]+/*"


def test_an_expression_does_not_travel_and_is_applied_here():
    rules = Filters({"ignore_topics": [EXPRESSION, "/tf"], "ignore_nodes": ["/loud"]}).rules("robot2")
    there = read_rules(write_rules(rules, False))
    assert there.topic("/node", "/front_left/camera_1/image", "x/Y", True)
    assert not rules.topic("/node", "/front_left/camera_1/image", "x/Y", True)
    assert not there.topic("/loud", "/map", "x/Y", True) and not there.topic("/node", "/tf", "x/Y", True)


def test_a_white_list_with_an_expression_takes_others_along():
    """Without its topics, a white list of nodes would leave out there what is wanted here."""
    rules = Filters({"sync_topics": [EXPRESSION], "sync_nodes": ["/driver"], "sync_services": ["/reset"]}).rules(
        "robot2"
    )
    there = read_rules(write_rules(rules, False))
    for node, topic in (("/node", "/front_left/camera_1/image"), ("/driver", "/map")):
        assert rules.topic(node, topic, "x/Y", True) and there.topic(node, topic, "x/Y", True)
    assert there.service("/node", "/reset") and not rules.service("/node", "/other")


def test_more_than_others_take_is_applied_here_alone():
    names = [f"/number_{number}" for number in range(2500)]
    rules = Filters({"ignore_topics": names, "ignore_services": names}).rules("robot2")
    assert read_rules(write_rules(rules, False)) == Rules()
    assert read_rules([False, *[rf"\A/number_{number}.*\Z" for number in range(10)]]) != Rules()
    assert not rules.topic("/node", "/number_2499", "x/Y", True)
