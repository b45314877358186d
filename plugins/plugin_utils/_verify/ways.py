# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Ways of packets between two computers of a fleet: source address, next hop, gateways on the way.

Pure: the plan of the fleet in, facts out. Everything is looked up, nothing is searched.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from ipaddress import IPv4Address
from typing import NamedTuple

from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._fleet.model import Gateway
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan.model import (
    ComputerPlan,
    FleetPlan,
    Master,
    Member,
)


class Way(NamedTuple):
    """A way from an observer to a target; a gateway is None where the way does not cross it."""

    source: IPv4Address
    next_hop: IPv4Address | None  # None on the same network
    own: Gateway | None  # of the observer's network
    its: Gateway | None  # of the target's network

    @property
    def crosses(self) -> bool:
        """True if the way leaves the observer's network."""
        return self.next_hop is not None


class Ways:
    """The plan of a fleet, indexed for questions about ways and masters."""

    def __init__(self, fleet: FleetPlan) -> None:
        self.members: Mapping[str, Member] = {member.name: member for member in fleet.members}
        self.gateways: Mapping[str, Gateway] = fleet.gateways  # robot -> gateway
        self.masters: Mapping[str, Master] = fleet.master_of
        self.names: Mapping[IPv4Address, frozenset[str]] = {
            entry.address: frozenset(name.lower() for name in entry.names) for entry in fleet.hosts_entries
        }
        self.robots: dict[str, list[str]] = {}  # robot -> its members
        for name, member in self.members.items():
            self.robots.setdefault(member.robot, []).append(name)
        first = [gateway.name for gateway in self.gateways.values() if gateway.name]
        known = set(first)
        self._gateways_first = first + [name for name in self.members if name not in known]
        # robot -> its members without the gateway
        self.inner = {robot: [name for name in names if name not in known] for robot, names in self.robots.items()}
        self._orders: dict[str, Sequence[str]] = {}

    def way(self, plan: ComputerPlan, target: str) -> Way:
        """Find the way from the computer of a plan to a member."""
        member = self.members[target]
        if plan.robot == member.robot:
            return Way(plan.address, None, None, None)
        own = None if plan.common_address else self.gateways.get(plan.robot)
        its = self.gateways.get(member.robot)
        if own:
            return Way(plan.address, own.address, own, its)
        return Way(plan.common_address or plan.address, its.common_address if its else None, None, its)

    def order(self, robot: str) -> Sequence[str]:
        """Sort the members for a computer of a robot: its own gateway first, then other gateways, then the rest.

        So whatever others depend on is looked at before them.
        """
        if robot not in self._orders:
            own = self.gateways[robot].name if robot in self.gateways else ""
            rest = [name for name in self._gateways_first if name != own]
            self._orders[robot] = [own, *rest] if own else rest
        return self._orders[robot]

    def master(self, robot: str) -> str:
        """Name the computer with the roscore of a robot; empty for the router, which has none."""
        return self.masters[robot].computer if robot in self.masters else ""
