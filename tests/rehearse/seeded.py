# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Mistakes that people make in an inventory, seeded into the shipped ones: a file each in the folder mistakes, data alone.

title: the gateway of a robot is misspelt
layout: multi_computer               # a folder of inventory/
set: {tibi: {variable: value}}       # of a group or a computer; null: not set
join: {tibi: [dabo-nav]}             # computers that are in this group, too
inject: {kobuki1computer: command}   # what is wrong on a machine, and `undo`, which takes it back
told: plan                           # plan: by the inventory alone; rehearsal: its first lines; machine: by preflight, on the machines;
                                     # prediction: by the prediction of reachability, as a warning of site.yml --check
words: ["the sentence"]              # parts of what is told
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

ROOT = Path(__file__).resolve().parents[2]
FOLDER = Path(__file__).with_name("mistakes")
PLAN, REHEARSAL, MACHINE, PREDICTION = "plan", "rehearsal", "machine", "prediction"

Groups = dict[str, dict[str, Any]]  # group -> hosts, children, vars, as Ansible reads it


@dataclass(frozen=True)
class Mistake:
    """One mistake."""

    name: str
    title: str
    layout: str
    told: str
    words: tuple[str, ...]
    set: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    join: Mapping[str, list[str]] = field(default_factory=dict)
    inject: Mapping[str, str] = field(default_factory=dict)
    undo: Mapping[str, str] = field(default_factory=dict)

    def robots(self) -> dict[str, list[str]]:
        """The robots with their computers."""
        return _robots(self.layout, self.join)

    def variables(self) -> dict[str, dict[str, Any]]:
        """All variables of each computer."""
        robots, layout = self.robots(), _layout(self.layout)
        of: dict[str, list[str]] = {host: ["robots", robot] for robot, hosts in robots.items() for host in hosts}
        of.update({host: ["robots"] for host in self.join.get("robots", ())})
        of.update({host: ["routers"] for host in layout.get("routers", {}).get("hosts", {})})
        found = {}
        for host, groups in of.items():
            values = {name: value for group in groups for name, value in _group_vars(self.layout, group).items()}
            values.update(_own(layout, host))
            for place in (*groups, host):
                values.update(self.set.get(place, {}))
            found[host] = values
        return found

    def routers(self) -> list[str]:
        """The hosts of the group `routers`."""
        return list(_layout(self.layout).get("routers", {}).get("hosts", {}))

    def strays(self) -> list[str]:
        """Computers of no robot."""
        return list(self.join.get("robots", ()))

    def inventory(self) -> Groups:
        """The same as Ansible reads it from a file."""
        variables = self.variables()
        groups: Groups = {
            "robots": {
                "hosts": dict.fromkeys(self.strays()),
                "children": {robot: {"hosts": dict.fromkeys(hosts)} for robot, hosts in self.robots().items()},
            },
            "routers": {"hosts": dict.fromkeys(self.routers())},
        }
        return {"all": {"hosts": variables, "children": groups}}


def load() -> list[Mistake]:
    """All mistakes, by name."""
    return [
        Mistake(**{"name": path.stem, **yaml.safe_load(path.read_text(encoding="utf-8"))})
        for path in sorted(FOLDER.glob("*.yml"))
    ]


def _layout(layout: str) -> dict[str, Any]:
    found: dict[str, Any] = yaml.safe_load((ROOT / "inventory" / layout / "hosts.yml").read_text(encoding="utf-8"))
    return found


def _robots(layout: str, join: Mapping[str, list[str]]) -> dict[str, list[str]]:
    children = _layout(layout)["robots"]["children"]
    return {robot: [*of["hosts"], *join.get(robot, ())] for robot, of in sorted(children.items())}


def _own(layout: Mapping[str, Any], host: str) -> dict[str, Any]:
    groups = [*layout["robots"]["children"].values(), layout.get("routers", {"hosts": {}})]
    return dict(next((group["hosts"][host] for group in groups if host in group["hosts"]), {}))


def _group_vars(layout: str, group: str) -> dict[str, Any]:
    path = ROOT / "inventory" / layout / "group_vars" / f"{group}.yml"
    found = yaml.safe_load(path.read_text(encoding="utf-8")) if path.exists() else {}
    return {name: value for name, value in found.items() if name.startswith("multimaster_")}
