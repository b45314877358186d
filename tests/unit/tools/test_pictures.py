# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The pictures of the pages: they are as the code and the shipped inventories say, their texts are apart, and a page has each."""

import re
from dataclasses import replace
from itertools import combinations
from xml.etree import ElementTree

import pytest

from tools.pictures import alone, fleets, sequences, shipped, verification
from tools.pictures.gallery import FOLDER, PICTURES
from tools.pictures.sheet import Sheet, measure

SVG = "{http://www.w3.org/2000/svg}"
PAGES = [shipped.ROOT / "README.md", *sorted((shipped.ROOT / "docs").rglob("*.md"))]
SMALL = {"small", "small aside"}


def texts(root):
    """The rectangles of the texts: left, top, right, bottom, and the words."""
    for text in root.iter(f"{SVG}text"):
        kind = text.get("class")
        size = 14 if kind == "title" else 11 if kind in SMALL else 12 if kind == "name" else 13
        x, y, wide = float(text.get("x")), float(text.get("y")), measure(text.text, size)
        left = x - wide if "end" in kind.split() else x - wide / 2 if "middle" in kind.split() else x
        yield left, y - size * 0.8, left + wide, y + size * 0.2, text.text


@pytest.mark.parametrize("name", PICTURES)
def test_a_picture_is_as_the_code_and_the_inventories_say(name):
    """`make pictures` writes them."""
    assert (FOLDER / f"{name}.svg").read_text(encoding="utf-8") == PICTURES[name]()


def test_there_are_no_other_pictures():
    assert {path.stem for path in FOLDER.glob("*.svg")} == set(PICTURES)


@pytest.mark.parametrize("name", PICTURES)
def test_texts_are_apart_and_inside(name):
    root = ElementTree.fromstring(PICTURES[name]())
    width, height = float(root.get("width")), float(root.get("height"))
    found = list(texts(root))
    assert len(found) > 5 and width <= 440
    for left, top, right, bottom, words in found:
        assert left >= 0 and top >= 0 and right <= width and bottom <= height, words
    for one, other in combinations(found, 2):
        apart = one[2] <= other[0] or other[2] <= one[0] or one[3] <= other[1] or other[3] <= one[1]
        assert apart, (one, other)


@pytest.mark.parametrize("name", PICTURES)
def test_a_picture_has_a_title_and_a_description_and_loads_nothing(name):
    drawn = PICTURES[name]()
    root = ElementTree.fromstring(drawn)
    named = [root.find(f"{SVG}*[@id='{key}']").text for key in root.get("aria-labelledby").split()]
    assert root.get("role") == "img" and len(named) == 2 and all(len(words) > 20 for words in named)
    assert "prefers-color-scheme: dark" in drawn and len(drawn) < 12_000
    assert not re.search(r"href|url\(|@import|<script|<image|https?://(?!www\.w3\.org/2000/svg)", drawn)


@pytest.mark.parametrize("name", PICTURES)
def test_a_page_has_the_picture_with_words_in_its_place(name):
    written = "\n".join(page.read_text(encoding="utf-8") for page in PAGES)
    found = re.findall(rf"^!\[([^\]]+)\]\([./\w]*images/{name}\.svg\)$", written, re.MULTILINE)
    assert found and all(len(words) > 20 for words in found)


def test_a_port_that_the_picture_of_the_programs_lacks_is_an_error():
    fleet = shipped.read_plan("single_computer")
    plan = fleet.computers["kobuki1computer"]
    assert fleets._list_ports(plan, fleet) == {"roscore": ["TCP 11311"], "discovery": ["UDP 11511", "TCP 11611"]}
    with pytest.raises(ValueError, match="11511"):
        fleets._list_ports(replace(plan, ports=plan.ports[:2]), fleet)


def test_another_order_of_the_tasks_of_verify_is_an_error():
    steps = list(verification.list_steps({"verify_lifetime": 300}))
    verification.check_order(steps)
    with pytest.raises(ValueError, match="Judge the measurements"):
        verification.check_order([steps[-1], *steps[:-1]])
    with pytest.raises(ValueError, match="Dance"):
        verification.check_order([*steps, verification.Step(("Dance",), False, ("dance",))])


def test_a_unit_that_waits_for_the_network_is_an_error():
    alone.check_units([{"name": "a.service", "content": "[Unit]\nAfter=multimaster-roscore.service\n"}])
    with pytest.raises(ValueError, match=r"a\.service"):
        alone.check_units([{"name": "a.service", "content": "[Unit]\nAfter=network-online.target\n"}])


def test_a_text_that_leaves_the_sheet_or_its_box_is_an_error():
    sheet = Sheet()
    with pytest.raises(ValueError, match="leaves the sheet"):
        sheet.text(400, 10, "a long text")
    with pytest.raises(ValueError, match="leaves its box"):
        sheet.box(0, 0, 40, ["a long text"])


def test_the_steps_of_the_exchange_are_those_of_its_page():
    drawn = ElementTree.fromstring(sequences.draw_exchange())
    numbers = [int(words.split()[0]) for *_place, words in texts(drawn) if words[0].isdigit()]
    page = (shipped.ROOT / "docs/understand/nodes.md").read_text(encoding="utf-8")
    listed = re.findall(r"^(\d)\. ", page, re.MULTILINE)
    assert numbers == list(map(int, listed)) == list(range(1, 8))
