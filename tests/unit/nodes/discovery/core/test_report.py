# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The entries of /diagnostics."""

import pytest
from rosfleet_multimaster.discovery.core.health import ClockAnswer, LinkHealth, LinkList
from rosfleet_multimaster.discovery.core.outsiders import Outsider
from rosfleet_multimaster.discovery.core.report import links, outsiders, roscore
from rosfleet_multimaster.protocol.messages import ERROR, OK, VALUES, WARN

LINK = LinkHealth("tibi", "http://tibi:11311/", True, 100.0, 0.3, 0, ClockAnswer(0.002, 0.01))


def entries(*seen, left_out=0):
    return {entry.name: entry for entry in links(LinkList(seen, left_out))}


@pytest.mark.parametrize(
    ("change", "level", "message"),
    [
        ({}, OK, "online"),
        ({"quality": -1.0}, OK, "online"),
        ({"quality": 40.0}, WARN, "only 40 % of its heartbeats come"),
        ({"online": False, "silent": 8.0}, ERROR, "lost"),
        ({"online": False, "silent": None}, WARN, "not there"),
    ],
)
def test_the_entry_of_a_link(change, level, message):
    found = entries(LINK._replace(**change))
    entry = found["multimaster: link to tibi"]
    assert (entry.level, entry.message) == (level, message)
    assert found["multimaster: masters"].level == (OK if LINK._replace(**change).online else WARN)
    values = dict(entry.values)
    assert values["uri"] == "http://tibi:11311/" and values["answer"] == "2.0 ms"


@pytest.mark.parametrize(
    ("offset", "level"),
    [(0.01, OK), (-0.09, OK), (0.1005, OK), (0.102, WARN), (-0.3, WARN), (0.6, ERROR), (-9e9, ERROR)],
)
def test_clocks_that_are_surely_apart_are_told(offset, level):
    entry = entries(LINK._replace(answer=ClockAnswer(0.002, offset)))["multimaster: clocks"]
    assert entry.level == level and ("tibi" in entry.message) == (level != OK)
    assert entries(LINK._replace(answer=ClockAnswer(30.0, offset)))["multimaster: clocks"].level in (OK, ERROR)


def test_without_an_answer_nothing_is_said_of_clocks():
    assert entries(LINK._replace(answer=None))["multimaster: clocks"][:3] == (
        "multimaster: clocks",
        "not compared yet",
        [],
    )


def test_links_that_are_left_out_are_told():
    assert entries(LINK, left_out=7)["multimaster: masters"].values[-1] == ("more", "7 are not listed here")


def test_the_roscore():
    assert roscore("http://own:11311/", "").level == OK
    assert roscore("http://own:11311/", "its roscore does not answer").level == ERROR


def test_strangers_are_warnings_and_not_too_many():
    strangers = [Outsider(f"10.0.{number // 256}.{number % 256}", "", "", "why") for number in range(VALUES + 1)]
    assert outsiders([]).level == OK and len(outsiders(strangers).values) == VALUES + 1
