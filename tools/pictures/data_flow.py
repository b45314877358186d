# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The names that cross between three robots, by the declarations that their page shows."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from typing import Any

import yaml
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._inventory.exports import FROM_CLIENT, FROM_SERVER
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan.model import FleetPlan, PlannedFlow

from .sheet import EDGE, LINE, WIDTH, Sheet, measure
from .shipped import ROOT, plan_with

PAGE = ROOT / "docs/operate/data_flow.md"
COLUMNS = (0.13, 0.5, 0.87)  # the middles of the robots, as shares of the width
BOX = 84
STEP = 46  # between two flows

_BLOCK = re.compile(r"^```yaml\n# group_vars/(\w+)\.yml.*\n((?s:.*?))^```$", re.MULTILINE)


def read_declarations() -> dict[str, dict[str, Any]]:
    """Return the variables of the first two robots of the page."""
    blocks = _BLOCK.findall(PAGE.read_text(encoding="utf-8"))
    return {robot: yaml.safe_load(text) for robot, text in blocks[:2]}


def _list_names(flow: PlannedFlow) -> Iterator[str]:
    """Yield the names of a flow; the topics of an action are one name with several ends."""
    ends: dict[str, list[str]] = {}
    for name in flow.topics:
        base, _slash, end = name.rpartition("/")
        if end in FROM_CLIENT + FROM_SERVER:
            ends.setdefault(base, []).append(end)
        else:
            yield name
    yield from flow.services
    yield from (f"{base} {' '.join(parts)}" for base, parts in ends.items())


def _list_flows(fleet: FleetPlan) -> Iterator[tuple[str, Sequence[str], str]]:
    """Yield the giver, the takers and the names; a robot that declares nothing gives everything."""
    for flow in fleet.flows:
        for giver in flow.givers:
            yield giver, flow.to, ", ".join(_list_names(flow))
    for robot, master in fleet.master_of.items():
        if not master.declared:
            yield robot, [other for other in fleet.master_of if other != robot], "everything, since it declares nothing"


def draw_data_flow() -> str:
    """Draw an arrow from each giver to each taker, with the names above it."""
    fleet = plan_with("multi_computer", read_declarations())
    sheet, spoken = Sheet(), []
    places = dict(zip(fleet.master_of, (WIDTH * share for share in COLUMNS), strict=True))
    y = 74.0
    for giver, takers, names in _list_flows(fleet):
        half = measure(names) / 2 + EDGE
        ends = [places[robot] for robot in (giver, *takers)]
        middle = (min(ends) + max(ends)) / 2
        sheet.text(min(max(middle, half), WIDTH - half), y, names, "middle on")
        for taker in takers:
            sheet.arrow(complex(places[giver], y + 10), complex(places[taker], y + 10))
        spoken.append(f"{giver} gives {' and '.join(takers)} {names}")
        y += STEP
    for robot, x in places.items():
        sheet.box(x - BOX / 2, EDGE, BOX, [robot])
        sheet.line(complex(x, EDGE + LINE + 10), complex(x, y - 24), "life")
    return sheet.finish(int(y - 14), "The names that cross between tibi, dabo and car", f"{'; '.join(spoken)}.")
