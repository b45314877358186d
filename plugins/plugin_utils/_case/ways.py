# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Ways of packets between two computers of a fleet: source address, next hop, gateways on the way.

Pure: the plan of the fleet in, facts out. Everything is looked up, nothing is searched.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from .._fleet.model import Gateway
from .._plan.model import COMMON, ComputerPlan, FleetPlan, Master, Member
from .parts import Part


class Way(NamedTuple):
    """A way from an observer to a target; a gateway is None where the way does not cross it."""

    source: str
    next_hop: str | None  # None on the same network
    own: Gateway | None  # of the observer's network
    its: Gateway | None  # of the target's network
    # the gateways that the route may have; an empty text is a route without a gateway
    hops: frozenset[str] = frozenset([""])

    @property
    def crosses(self) -> bool:
        """True if the way leaves the observer's network."""
        return self.next_hop is not None


def _describe_roscore(part: Part) -> str:
    """Say what a roscore shows. Without a word of it, it does not answer."""
    return f"calls itself {part.what}" if part.mode == "name" and part.what else ""


class Ways:
    """The plan of a fleet, indexed for questions about ways and masters."""

    def __init__(self, fleet: FleetPlan) -> None:
        self.members: Mapping[str, Member] = {member.name: member for member in fleet.members}
        self.gateways: Mapping[str, Gateway] = fleet.gateways  # robot -> gateway
        self._router = fleet.router
        self.group = f"{fleet.multicast_group}:{fleet.multicast_port}"
        self.masters: Mapping[str, Master] = fleet.master_of
        # names and address of each member, in small letters
        names = {entry.address: [name.lower() for name in entry.names] for entry in fleet.hosts_entries}
        self.called: Mapping[str, frozenset[str]] = {
            name: frozenset([name.lower(), str(member.address), *names.get(member.address, ())])
            for name, member in self.members.items()
        }
        # as texts, because observations have texts
        self.addresses = {name: str(member.address) for name, member in self.members.items()}
        self.discovery_addresses = {name: str(member.discovery_address) for name, member in self.members.items()}
        self._known: dict[tuple[str, str], Way] = {}  # by computer, and robot of the target
        # of all interfaces, also those of devices
        self._at = {str(entry.address): name for name, plan in fleet.computers.items() for entry in plan.networks}
        for gateway in self.gateways.values():
            self._at.update({str(gateway.address): gateway.title, str(gateway.common_address): gateway.title})
        self.titles = frozenset(gateway.title for gateway in self.gateways.values())
        self.master_uris: Mapping[str, tuple[str, ...]] = fleet.master_uris  # by robot
        self.sealed_roscores: Mapping[str, str] = fleet.companions  # by companion
        self.master_at: Mapping[str, Master] = {master.computer: master for master in fleet.masters}
        self.parts: dict[tuple[str, str], frozenset[Part]] = {}  # between two computers, as needs.way finds them

    def seal(self, parts: frozenset[Part]) -> frozenset[Part]:
        """Say of the roscores on sealed computers that they are there: nobody can look at them, or start them again, from here."""
        if not self.sealed_roscores:
            return parts
        return frozenset(
            Part("roscore", self.sealed_roscores[part.place], "sealed", _describe_roscore(part))
            if part.kind == "roscore" and part.place in self.sealed_roscores
            else part
            for part in parts
        )

    def network(self, robot: str) -> str:
        """Name the network of a robot's computers."""
        return f"the network of {robot}" if robot in self.gateways else COMMON

    def name_at(self, address: str) -> str:
        """Name the computer with an address; empty where none is known."""
        return self._at.get(address, "")

    def way(self, plan: ComputerPlan, target: str) -> Way:
        """Find the way from the computer of a plan to a member."""
        key = plan.computer, self.members[target].robot
        if key not in self._known:
            self._known[key] = self._way(plan, key[1])
        return self._known[key]

    def _way(self, plan: ComputerPlan, robot: str) -> Way:
        if plan.robot == robot:
            return Way(str(plan.address), None, None, None)
        own = None if plan.common_address else self.gateways.get(plan.robot)
        its = self.gateways.get(robot)
        if own:
            hop = str(own.address)
            return Way(str(plan.address), hop, own, its, frozenset([hop]))
        if not its:
            return Way(str(plan.common_address or plan.address), None, None, None)
        hops = {str(its.common_address)}
        if plan.common_address and plan.routes_expected and self._router:
            hops.add(str(self._router.address))  # with multimaster_routes: existing they may go by the router
        return Way(str(plan.common_address or plan.address), str(its.common_address), None, its, frozenset(hops))

    def master(self, robot: str) -> str:
        """Name the computer with the roscore of a robot; empty for the router, which has none."""
        return self.masters[robot].computer if robot in self.masters else ""
