# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The way of followed packets: a column for each computer, an arrow for each step, one cross where they end."""

from xml.etree import ElementTree

import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._base.plain import to_plain
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.report.hops import COLUMN, ROW, draw_way
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.trace.findings import DrawnWay
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.trace.place import SeenHop
from hypothesis import given
from hypothesis import strategies as st
from mentioned import mentions

SVG = "{http://www.w3.org/2000/svg}"
MAC = "02:00:00:00:00:02"
PLANNED = ("one", "gate", "two")
EVIL = '"><script>alert(1)</script>&\x1b[31m\u202e' + "x" * 500


def hop(sender, receiver, answer=False, arrived=True, **more):
    values = {"network": "the network of x", "left": "eth0", "target_mac": MAC, "ttl": 64}
    came = "eth1" if arrived else ""
    return SeenHop(sender, receiver, answer=answer, arrived=arrived, came=came, **{**values, **more})


def draw(hops, at, words="pings end here", computers=PLANNED):
    return ElementTree.fromstring(draw_way(to_plain(DrawnWay(computers, tuple(hops), at, words))))


def list_class(root, tag, kind):
    return [element for element in root.iter(SVG + tag) if kind in element.get("class", "").split()]


def find_cross(root):
    """The middle of the only cross."""
    (cross,) = list_class(root, "path", "cross")
    x, y = cross.get("d").split()[0][1:].split(",")
    return float(x) + 7, float(y) + 7


def column(root, name):
    box = next(group for group in root.iter(SVG + "g") if group.findtext(SVG + "title") == name).find(SVG + "rect")
    return float(box.get("x")) + float(box.get("width")) / 2


THERE = [hop("one", "gate"), hop("gate", "two")]


def test_an_answer_goes_back_and_the_cross_is_where_it_ends():
    root = draw([*THERE, hop("two", "gate", answer=True, ttl=1)], "gate")
    ends = [(float(line.get("x1")), float(line.get("x2"))) for line in list_class(root, "line", "hop")]
    one, gate, two = (column(root, name) for name in PLANNED)
    assert ends == [(one, gate), (gate, two), (two, gate)] and one < gate < two
    assert len(list(root.iter(SVG + "polygon"))) == 3 and not list_class(root, "line", "lost")
    assert find_cross(root)[0] == gate
    texts = [text.text for text in root.iter(SVG + "text")]
    assert "answer out eth0, TTL 1; in eth1" in texts and f"to {MAC} in the network of x" in texts
    assert "\u2716 pings end here" in texts


@pytest.mark.parametrize(("receiver", "answer"), [("two", False), ("", False), ("one", True), ("", True)])
def test_what_nobody_saw_come_in_is_a_broken_line(receiver, answer):
    root = draw([hop("one", "gate"), hop("gate", receiver, answer, arrived=False)], "gate")
    (lost,) = list_class(root, "line", "lost")
    begin, end = float(lost.get("x1")), float(lost.get("x2"))
    assert begin == column(root, "gate") and (end < begin) == answer
    assert find_cross(root) == ((begin + end) / 2, float(lost.get("y1")))
    assert len(list(root.iter(SVG + "polygon"))) == 1


def test_what_does_not_leave_its_sender_has_a_cross_there():
    root = draw([], "one")
    assert find_cross(root)[0] == column(root, "one")
    assert len(list_class(root, "rect", "missed")) == 2


def test_a_report_of_a_stranger_ends_at_the_last_step():
    assert find_cross(draw(THERE, "10.9.9.9"))[0] == column(draw(THERE, "two"), "two")


def test_a_computer_beside_the_plan_has_a_column_too():
    root = draw([hop("one", "router"), hop("router", "two")], "two")
    columns = {name: column(root, name) for name in (*PLANNED, "router")}
    assert sorted(columns, key=columns.get) == ["one", "router", "gate", "two"]
    assert [box.get("class") for box in list_class(root, "rect", "missed")] == ["box missed"]


def test_the_same_is_told_in_words():
    (svg,) = draw([hop("one", "", arrived=False)], "one")
    assert svg.get("role") == "img"
    assert mentions(svg.get("aria-label"), "eth0", "TTL", "64", MAC)


TEXT = st.sampled_from(["", "eth0", EVIL, "\x00\ud800"]) | st.text(max_size=40)
NAMES = st.sampled_from([*PLANNED, EVIL])
SEEN = TEXT, TEXT, TEXT, st.integers(), st.booleans()
STEPS = st.lists(st.builds(SeenHop, NAMES, NAMES, *SEEN, st.just(True), TEXT), max_size=31)
LAST = st.lists(st.builds(SeenHop, NAMES, NAMES | st.just(""), *SEEN, st.just(False)), max_size=1)


@given(STEPS, LAST, NAMES | TEXT, TEXT)
def test_whatever_computers_tell_stays_within_the_picture(steps, last, at, words):
    root = draw([*steps, *last], at, words, (EVIL, *PLANNED))
    (svg,) = root
    assert {element.tag.removeprefix(SVG) for element in svg.iter()} <= {
        *("svg", "style", "g", "title", "rect", "text", "line", "path", "polygon")
    }
    width, height = float(svg.get("width")), float(svg.get("height"))
    assert width == 4 * COLUMN and height <= 33 * ROW + 400
    x, y = find_cross(root)
    assert 0 <= x <= width and 0 <= y <= height
    for text in root.iter(SVG + "text"):
        assert len(text.text or "") <= 70 and 0 <= float(text.get("x")) <= width and 0 <= float(text.get("y")) <= height
