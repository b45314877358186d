# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Which way packets are to take between two computers of a fleet: source address, next hop, gateways on the way.

Pure: the plan of `fleet_plan` in, facts out; everything is looked up, nothing is searched.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple


class Gateway(NamedTuple):
    """The gateway of a robot network: its computer (empty for a device that is none) and its two addresses."""

    name: str
    address: str
    common_address: str

    @property
    def title(self) -> str:
        """How a person finds it."""
        return self.name or self.address


class Way(NamedTuple):
    """From `source` by `hop` (empty on the same network), through the gateways `own` and `its`, None if not crossed."""

    source: str
    hop: str
    own: Gateway | None
    its: Gateway | None

    @property
    def crosses(self) -> bool:
        """Whether it leaves the observer's network."""
        return bool(self.hop)


class Layout:
    """A fleet, indexed for questions about ways and masters."""

    def __init__(self, fleet: Mapping[str, Any]) -> None:
        self.members: dict[str, Mapping[str, Any]] = {member["name"]: member for member in fleet["members"]}
        computers = {plan["robot"]: name for name, plan in fleet["computers"].items() if plan["is_gateway"]}
        self.gateways = {
            entry["robot"]: Gateway(computers.get(entry["robot"], ""), entry["gateway"], entry["common_address"])
            for entry in fleet["networks"]
        }
        self.masters: dict[str, Mapping[str, Any]] = {entry["robot"]: entry for entry in fleet["masters"]}
        self.names: dict[str, frozenset[str]] = {
            entry["address"]: frozenset(name.lower() for name in entry["names"]) for entry in fleet["hosts_entries"]
        }
        self.robots: dict[str, list[str]] = {}
        for name, member in self.members.items():
            self.robots.setdefault(member["robot"], []).append(name)
        first = [gateway.name for gateway in self.gateways.values() if gateway.name]
        self._gateways_first = first + [name for name in self.members if name not in set(first)]
        self.inner = {robot: [name for name in names if name not in first] for robot, names in self.robots.items()}
        self._orders: dict[str, Sequence[str]] = {}

    def way(self, plan: Mapping[str, Any], target: str) -> Way:
        """The way from the computer of a plan to a member."""
        member = self.members[target]
        if plan["robot"] == member["robot"]:
            return Way(plan["address"], "", None, None)
        own = None if plan["common_address"] else self.gateways.get(plan["robot"])
        its = self.gateways.get(member["robot"])
        if own:
            return Way(plan["address"], own.address, own, its)
        return Way(plan["common_address"] or plan["address"], its.common_address if its else "", None, its)

    def order(self, robot: str) -> Sequence[str]:
        """The members, as a computer of a robot looks at them: what others depend on first, its own gateway before all."""
        if robot not in self._orders:
            own = self.gateways[robot].name if robot in self.gateways else ""
            rest = [name for name in self._gateways_first if name != own]
            self._orders[robot] = [own, *rest] if own else rest
        return self._orders[robot]

    def master(self, robot: str) -> str:
        """The computer with the roscore of a robot; empty for the router, which has none."""
        return self.masters[robot]["computer"] if robot in self.masters else ""
