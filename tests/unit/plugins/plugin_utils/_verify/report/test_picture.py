# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The picture of the shipped inventories (golden files), its marks, and large fleets.

The files in golden/report are written anew by UPDATE_GOLDEN=1 pytest tests/unit/plugins/plugin_utils/_verify/report/test_picture.py
"""

import os
import pathlib
from itertools import combinations
from xml.etree import ElementTree

import fleets
import pytest
from ansible.inventory.manager import InventoryManager
from ansible.parsing.dataloader import DataLoader
from ansible.vars.manager import VariableManager
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._inventory import read
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan import plan as plan_module
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.report.picture import draw_fleet, list_robots

ROOT = pathlib.Path(__file__).resolve().parents[6]
GOLDEN = ROOT / "tests/unit/golden/report"
SVG = "{http://www.w3.org/2000/svg}"


def shipped(name):
    """The plan of a shipped inventory, as Ansible reads it."""
    loader = DataLoader()
    inventory = InventoryManager(loader=loader, sources=[str(ROOT / "inventory" / name)])
    variables = VariableManager(loader=loader, inventory=inventory)
    hosts = {
        host.name: {
            key: value for key, value in variables.get_vars(host=host).items() if key.startswith("multimaster_")
        }
        for host in inventory.get_hosts()
    }
    robots = {group.name: [host.name for host in group.hosts] for group in inventory.groups["robots"].child_groups}
    routers = [host.name for host in inventory.groups["routers"].hosts] if "routers" in inventory.groups else []
    return plan_module.fleet_plan(read.read_fleet(read.Inventory(robots=robots, variables=hosts, routers=routers)))


@pytest.mark.parametrize("name", ["single_computer", "multi_computer"])
def test_golden_files(name):
    path = GOLDEN / f"{name}.svg"
    drawn = draw_fleet(shipped(name))
    if os.environ.get("UPDATE_GOLDEN"):
        path.write_text(drawn, encoding="utf-8")
    assert drawn == path.read_text(encoding="utf-8")


def boxes(root):
    """The rectangles of computers: x, y, width, height."""
    found = [rect for rect in root.iter(SVG + "rect") if rect.get("class", "").startswith("box")]
    return [tuple(float(rect.get(key)) for key in ("x", "y", "width", "height")) for rect in found]


@pytest.mark.parametrize(
    "fleet",
    [fleets.plan(1), fleets.plan(2), fleets.plan(7, 3), fleets.plan(100, 4), fleets.fig12(), shipped("multi_computer")],
    ids=["1", "2", "7x3", "100x4", "fig12", "shipped"],
)
def test_every_computer_has_a_box_of_its_own_in_the_picture(fleet):
    root = ElementTree.fromstring(draw_fleet(fleet))
    width, height = float(root.get("width")), float(root.get("height"))
    found = boxes(root)
    assert len(found) == len(fleet.computers) and width <= 1200
    for x, y, wide, high in found:
        assert x >= 0 and y >= 0 and x + wide <= width and y + high <= height
    places = sorted(found)
    near = places if len(places) < 50 else places[:50]
    for (x, y, wide, high), (left, top, broad, tall) in combinations(near, 2):
        assert x + wide <= left or left + broad <= x or y + high <= top or top + tall <= y


@pytest.mark.parametrize(("columns", "most"), [(1, 240), (2, 400)])
def test_a_narrow_picture_has_its_robots_below_each_other(columns, most):
    root = ElementTree.fromstring(draw_fleet(shipped("multi_computer"), width=most, columns=columns))
    frames = [float(rect.get("y")) for rect in root.iter(SVG + "rect") if rect.get("class") == "robot"]
    assert float(root.get("width")) <= most and len(boxes(root)) == 13 and len(set(frames)) == len(frames) == 3
    labels = [text.text for text in root.iter(SVG + "text")]
    assert sum("the same network" in label for label in labels) == 2
    ends = [float(line.get("y2")) for line in root.iter(SVG + "line")]
    bars = [float(rect.get("y")) for rect in root.iter(SVG + "rect") if rect.get("class") == "bar"]
    assert min(bars) in ends, "the router is not at the common network"


def finding(place, verdict, sentence):
    return {"place": place, "verdict": verdict, "sentence": sentence, "rivals": []}


def test_a_mark_has_a_sign_a_number_and_a_link_at_its_place():
    findings = [
        finding("tibi-visio", "failed", "it drops <b>everything</b>"),
        finding("the network of dabo", "warning", "it is slow"),
        finding("dabo and car", "unknown", "both have a node /one"),
    ]
    root = ElementTree.fromstring(draw_fleet(fleets.fig12(), findings))
    links = [(link.get("href"), "".join(link.itertext())) for link in root.iter(SVG + "a")]
    assert [href for href, _text in links].count("#finding-3") == 2
    texts = dict(links)
    assert texts["#finding-1"].endswith("\u2716 1") and "it drops <b>everything</b>" in texts["#finding-1"]
    assert texts["#finding-2"].endswith("\u25b2 2") and texts["#finding-3"].endswith("? 3")
    classes = [rect.get("class") for rect in root.iter(SVG + "rect")]
    assert "box is-failed" in classes and "bar is-warning" in classes and classes.count("robot is-unknown") == 2


def test_robots_with_findings_come_first_with_the_numbers_of_these():
    fleet = fleets.fig12()
    robots = list(fleet.master_of)
    last, other = robots[-1], robots[0]
    inner, outer = (
        next(plan.computer for plan in fleet.computers.values() if plan.robot == robot) for robot in (last, other)
    )
    findings = [
        finding(f"the network of {last}", "warning", "a"),
        finding(f"{inner} and {outer}", "failed", "b"),
        finding("the common network", "failed", "c"),
    ]
    found = [(entry.robot, entry.verdict, entry.numbers) for entry in list_robots(fleet, findings)]
    well = [(robot, "ok", ()) for robot in robots if robot not in (last, other)]
    assert found == [(other, "failed", (2,)), (last, "failed", (1, 2)), *well]


def test_many_marks_at_one_place_are_counted():
    root = ElementTree.fromstring(draw_fleet(fleets.fig12(), [finding("tibi-visio", "failed", "x")] * 9))
    assert [link.get("href") for link in root.iter(SVG + "a")] == [f"#finding-{number}" for number in range(1, 5)]
    assert "6 more" in "".join(root.itertext())


def test_who_discovers_whom():
    text = "".join(ElementTree.fromstring(draw_fleet(fleets.fig12(), unseen={"tibi": ["car"]})).itertext())
    assert "discovers dabo" in text and "does not discover car" in text and "discovers tibi, car" in text
    assert "discovers kobuki2, kobuki3, kobuki4 and 96 more" in draw_fleet(fleets.plan(100))
