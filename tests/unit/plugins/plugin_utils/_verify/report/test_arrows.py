# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Arrows of discovery: one for each ordered pair, told by its line and sign, not by colour alone."""

from xml.etree import ElementTree

import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.report.arrows import MOST, draw_arrows

SVG = "{http://www.w3.org/2000/svg}"


def drawn(robots, unseen, read):
    return ElementTree.fromstring(draw_arrows(robots, unseen, read))


def test_an_arrow_for_each_and_what_is_wrong_at_its_place():
    root = drawn(["tibi", "dabo", "car"], {"tibi": ["car"]}, {"tibi", "dabo"})
    titles = [title.text for title in root.iter(SVG + "title")]
    assert len(list(root.iter(SVG + "path"))) == 6 and "tibi discovers dabo" in titles
    assert "tibi does not discover car" in titles and "car was not asked whether it discovers tibi" in titles
    kinds = sorted(path.get("class") for path in root.iter(SVG + "path"))
    assert kinds == ["arrow"] * 3 + ["arrow failed"] + ["arrow unknown"] * 2
    assert [text.text for text in root.iter(SVG + "text") if text.get("class") == "sign failed"].count("\u2716") == 1


@pytest.mark.parametrize("number", [2, 3, 7, MOST])
def test_everything_is_inside_and_no_box_lies_on_another(number):
    robots = [f"a-robot-with-a-long-name-{n}" for n in range(number)]
    root = drawn(robots, {}, robots)
    width, height = float(root.get("width")), float(root.get("height"))
    boxes = [tuple(float(box.get(key)) for key in ("x", "y", "width", "height")) for box in root.iter(SVG + "rect")]
    assert len(boxes) == number
    for position, (x, y, wide, high) in enumerate(boxes):
        assert 0 <= x <= x + wide <= width and 0 <= y <= y + high <= height
        assert all(abs(x - u) >= wide or abs(y - v) >= high for u, v, _wide, _high in boxes[:position])


@pytest.mark.parametrize("number", [0, 1, MOST + 1])
def test_too_few_or_too_many_have_none(number):
    assert draw_arrows([str(n) for n in range(number)], {}, ()) == ""


def test_names_of_anybody_stay_texts():
    assert "<script" not in draw_arrows(["<script>", "b&\x1b"], {}, ())
