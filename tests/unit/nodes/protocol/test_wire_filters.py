# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
import time

import pytest
from rosfleet_multimaster.protocol.filters import NAMES, Filters, InvalidPattern, Pattern, Rules
from rosfleet_multimaster.protocol.wire_filters import read_pattern, read_rules, write_rules


@pytest.mark.parametrize(
    "text",
    [
        r"(a+)+b",
        r"(a*)*b",
        r"(a|b*)*c",
        r"(.*a){20}",
        r".*.*.*.*.*.*.*x",
        r"(a)\1",
        r"(a{0,16}){0,16}b",
        "a?" * 40 + "b",
        "(?:ab|a|b)" * 40 + "c",
        r"(ab|a)+c",
        "[\\0-\\U0010ffff]",
    ],
)
def test_costly_patterns_of_others_are_refused(text):
    with pytest.raises(InvalidPattern, match="costly"):
        read_pattern(text)


@pytest.mark.parametrize("text", [r"\A/cam[0-9]?/(left|right)/.*\Z", "|".join(rf"\A/topic{n}\Z" for n in range(2000))])
def test_ordinary_patterns_of_others_are_not_costly(text):
    assert read_pattern(text)


def test_the_costs_of_alternatives_add_up():
    names = [f"/topic{number}" for number in range(500)]
    assert read_pattern(Pattern.from_items([*names, *(f"{name}*" for name in names), "/a*b*c", "/a*b*d"]).text)
    with pytest.raises(InvalidPattern, match="costly"):
        read_pattern(Pattern.from_items([f"/{name}*/*" for name in names]).text)


def test_the_worst_pattern_that_is_accepted_ends():
    pattern = read_pattern(r"\A" + ".*" * 3 + r"x\Z")
    started = time.thread_time()
    assert not pattern.matches("/" + "a" * 254)
    assert time.thread_time() - started < 1
    with pytest.raises(InvalidPattern, match="costly"):
        read_pattern(r"\A" + ".*" * 4 + r"x\Z")


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
        [False, "("] + [""] * 6,
        [False, "a" * 70000] + [""] * 6,
    ],
)
def test_what_is_no_filter_is_refused(value):
    with pytest.raises(InvalidPattern):
        read_rules(value)


def test_a_pattern_that_others_refuse_is_applied_here_alone():
    """Else a robot with such a filter would get nothing at all from the other one."""
    costly = "/(front|rear)_(left|right)/camera_[0-9]+/.*"
    with pytest.raises(InvalidPattern):
        read_pattern(Pattern.from_items([costly]).text)
    rules = Filters({"ignore_topics": [costly], "ignore_nodes": ["/loud"]}).rules("robot2")
    there = read_rules(write_rules(rules, False))
    assert there.topic("/node", "/front_left/camera_1/image", "x/Y", True)
    assert not rules.topic("/node", "/front_left/camera_1/image", "x/Y", True)
    assert not there.topic("/loud", "/map", "x/Y", True)


def test_a_white_list_that_others_refuse_takes_others_along():
    """Without its topics, a white list of nodes would leave out there what is wanted here."""
    costly = "/(front|rear)_(left|right)/camera_[0-9]+/.*"
    rules = Filters({"sync_topics": [costly], "sync_nodes": ["/driver"], "sync_services": ["/reset"]}).rules("robot2")
    there = read_rules(write_rules(rules, False))
    for node, topic in (("/node", "/front_left/camera_1/image"), ("/driver", "/map")):
        assert rules.topic(node, topic, "x/Y", True) and there.topic(node, topic, "x/Y", True)
    assert there.service("/node", "/reset") and not rules.service("/node", "/other")


def test_more_than_others_take_is_applied_here_alone():
    names = [f"/number_{number}" for number in range(2500)]
    rules = Filters({"ignore_topics": names, "ignore_services": names}).rules("robot2")
    assert read_rules(write_rules(rules, False)) == Rules()
    assert not rules.topic("/node", "/number_2499", "x/Y", True)
