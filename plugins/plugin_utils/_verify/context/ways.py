# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Ways of packets between two computers of a fleet: source address, next hop, links and gateways on the way.

Pure: the plan of the fleet in, facts out. Everything is looked up, nothing is searched.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from typing import NamedTuple

from ..._inventory.model import Gateway
from ..._plan.model import COMMON, ComputerPlan, FleetPlan, Master, Member
from ..components.component import Component


class Way(NamedTuple):
    """A way from an observer to a target."""

    source: str
    next_hop: str | None  # None on the same network
    # the gateways that the route may have; an empty text is a route without a gateway
    hops: frozenset[str] = frozenset([""])

    @property
    def crosses(self) -> bool:
        """True if the way leaves the observer's network."""
        return self.next_hop is not None


def _describe_roscore(component: Component) -> str:
    """Describe the answer of a roscore. Without one, it does not answer."""
    return f"calls itself {component.what}" if component.mode == "name" and component.what else ""


class Ways:
    """The plan of a fleet, indexed for questions about ways and masters."""

    def __init__(self, fleet: FleetPlan) -> None:
        self._fleet = fleet
        self.members: Mapping[str, Member] = {member.name: member for member in fleet.members}
        self.gateways: Mapping[str, Gateway] = fleet.gateways  # robot -> gateway
        self.group = f"{fleet.multicast_group}:{fleet.multicast_port}"
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
        self.master_at: Mapping[str, Master] = {master.computer: master for master in fleet.masters}
        self.components: dict[
            tuple[str, str], frozenset[Component]
        ] = {}  # between two computers, as needs.way finds them

    def seal(self, components: frozenset[Component]) -> frozenset[Component]:
        """Say of the roscores on sealed computers that they are there: the collection can neither look at them nor start them again."""
        sealed = self._fleet.companions
        if not sealed:
            return components
        return frozenset(
            Component("roscore", sealed[component.place], "sealed", _describe_roscore(component))
            if component.kind == "roscore" and component.place in sealed
            else component
            for component in components
        )

    def network(self, robot: str) -> str:
        """Name the network of a robot's computers."""
        return f"the network of {robot}" if robot in self.gateways else COMMON

    def robot_of(self, computer: str) -> str:
        """Name the robot of a computer; empty for the router."""
        return self.members[computer].robot if computer in self.members else ""

    def network_of(self, computer: str) -> str:
        """Name the network of a computer's address; the router's is the common one."""
        return self.network(self.robot_of(computer))

    def master_of(self, computer: str) -> str:
        """Name the computer with the roscore of a computer's robot; empty for the router, which has no robot."""
        master = self._fleet.master_of.get(self.robot_of(computer))
        return master.computer if master else ""

    def find_gateway(self, computer: str) -> Gateway | None:
        """Return the gateway that a computer is behind."""
        plan = self._fleet.computers.get(computer)
        return None if plan is None or plan.common_address else self.gateways.get(self.robot_of(computer))

    def is_in(self, computer: str, network: str) -> bool:
        """Return True if a computer has an address in a network."""
        plan = self._fleet.computers.get(computer)
        return plan is not None and (
            network == self.network(plan.robot) or (bool(plan.common_address) and network == COMMON)
        )

    def list_links(self, one: str, other: str) -> list[tuple[str, str]]:
        """List the links on the way, as (computer, network), from one end to the other."""
        if self.robot_of(one) == self.robot_of(other):
            network = self.network_of(one)
            return [(one, network), (other, network)]
        return [*self._list_links_to_common(one), *reversed(self._list_links_to_common(other))]

    def _list_links_to_common(self, computer: str) -> list[tuple[str, str]]:
        gateway = self.find_gateway(computer)
        if gateway is None:
            return [(computer, COMMON)]
        network = self.network_of(computer)
        return [(computer, network), (gateway.title, network), (gateway.title, COMMON)]

    def list_forwarders(self, one: str, other: str) -> list[str]:
        """List the computers that forward the packets."""
        titles = [place for (place, _came), (next_, _left) in pairwise(self.list_links(one, other)) if place == next_]
        plan, router = self._fleet.computers.get(one), self._fleet.router
        if titles and plan and plan.routes_expected and router and router.name:
            titles.append(router.name)  # with multimaster_routes: existing they may go by it
        return titles

    def name_at(self, address: str) -> str:
        """Name the computer with an address; empty if no known computer has the address."""
        return self._at.get(address, "")

    def way(self, plan: ComputerPlan, target: str) -> Way:
        """Find the way from the computer of a plan to a member."""
        key = plan.computer, self.members[target].robot
        if key not in self._known:
            self._known[key] = self._way(plan, key[1])
        return self._known[key]

    def _way(self, plan: ComputerPlan, robot: str) -> Way:
        if plan.robot == robot:
            return Way(str(plan.address), None)
        if own := self.find_gateway(plan.computer):
            hop = str(own.address)
            return Way(str(plan.address), hop, frozenset([hop]))
        its, source = self.gateways.get(robot), str(plan.common_address or plan.address)
        if not its:
            return Way(source, None)
        hops = {str(its.common_address)}
        if plan.common_address and plan.routes_expected and self._fleet.router:
            hops.add(str(self._fleet.router.address))  # with multimaster_routes: existing they may go by the router
        return Way(source, str(its.common_address), frozenset(hops))
