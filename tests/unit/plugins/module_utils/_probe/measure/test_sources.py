# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The topics that discovery nodes have: real sockets, and answers of strangers."""

import time

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._base import deadlines
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.measure import sources
from talking import Roscore, served

ONE, TWO = "kobuki1computer", "kobuki2computer"
ROBOTS = {ONE: "kobuki1", TWO: "kobuki2"}
MINE, ITS = (f"/multimaster_verify/{name}" for name in (ONE, TWO))


class Discovery:
    """A discovery node whose state has these topics; it counts how often each method was asked."""

    def __init__(self, *names):
        self.rows, self.asked = [[name, ["/node"]] for name in names], []

    def masterInfo(self):
        self.asked.append("masterInfo")
        return ["1.0", "1.0", "http://a:11311/", "a", self.rows, [], [], [], [], []]

    def masterInfoFiltered(self, rules):
        assert len(rules) == 11
        self.asked.append("masterInfoFiltered")
        return self.masterInfo()


@pytest.fixture(autouse=True)
def quickly(monkeypatch):
    monkeypatch.setattr(sources, "PAUSE", 0.05)
    monkeypatch.setattr(deadlines, "PAUSE", 0.05)
    monkeypatch.setattr(sources, "FOLLOWS", 0.3)


def look(ros, here, mine, its):
    """Ask both nodes, for a roscore with these topics."""
    found, _command = ros
    roscore = Roscore()
    roscore.publishers = {name: {"/node": "http://a:1/"} for name in here}
    with served(roscore) as found.uri, served(mine) as own, served(its) as other:
        masters = [{"computer": ONE, "monitor_uri": own}, {"computer": TWO, "monitor_uri": other}]
        rows = sources.sources(found, masters, ROBOTS, ONE, [TWO], time.monotonic())
    return {row["computer"]: row for row in rows}


def test_nobody_else_is_asked_where_nothing_is_missing(ros):
    its = Discovery()
    found = look(ros, [MINE, ITS, "/odom"], Discovery(MINE, ITS, "/odom"), its)
    assert found == {ONE: {"computer": ONE, "topics": [MINE], "given": [MINE], "error": "", "outcome": "answered"}}
    assert its.asked == []


def test_what_is_given_and_not_registered_is_told(ros):
    found = look(ros, [MINE], Discovery(MINE), Discovery(ITS))
    assert (found[TWO]["topics"], found[TWO]["given"]) == ([ITS], [ITS])


def test_a_topic_that_discovery_has_not_followed_is_told(ros):
    found = look(ros, [MINE, ITS, "/odom"], Discovery(MINE, ITS), Discovery())
    assert (found[ONE]["topics"], found[ONE]["given"]) == ([MINE, "/odom"], [MINE])


@pytest.mark.slow
@pytest.mark.parametrize(
    "rows", [None, 5, "text", [[1, 2]], [["x"]], [[["deep"], ["/n"]]], [[ITS, []]], [{"a": 1}], [["\x1b[31m", ["/n"]]]]
)
def test_an_answer_of_a_stranger_gives_nothing(ros, rows):
    strange = Discovery()
    strange.rows = rows
    found = look(ros, [MINE], Discovery(MINE), strange)
    assert found[TWO]["given"] == [] and "\x1b" not in found[TWO]["error"]


def test_a_node_that_does_not_answer_says_why(ros):
    class Dead(Discovery):
        def masterInfoFiltered(self, rules):
            raise ValueError("no roscore")

    found = look(ros, [MINE], Discovery(MINE), Dead())
    assert found[TWO]["outcome"] == "failed" and "no roscore" in found[TWO]["error"] and found[TWO]["given"] == []


def test_a_node_that_has_ended_says_why(ros):
    master = {"computer": TWO, "monitor_uri": "http://127.0.0.1:9/"}
    row = sources._read((master, set()), sources.server(master["monitor_uri"]).masterInfo)
    assert (row["error"], row["outcome"]) == ("Connection refused", "refused")


def test_without_a_roscore_nothing_is_told(ros):
    found, _command = ros
    found.uri = "http://127.0.0.1:9"
    assert sources.sources(found, [], ROBOTS, ONE, [TWO], time.monotonic()) == []
