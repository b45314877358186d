# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The world as a verification has read it, with the faults in it that values show. Pure.

The machines of the plan get the interfaces, rules and closed routes that were read on the computers, and the known faults. Packets that
the fleet sends end in this world, too, if one of these faults is the reason.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from ipaddress import IPv4Interface, IPv4Network

from ..._network import facts, packets, plan_world
from ..._network.model import Interface, Machine, Route, World, kernel_routes
from ..._plan.model import ComputerPlan, FleetPlan
from ..components.component import Component
from ..observe.observations import ForwardingInterface
from .check_context import FleetState, Participant
from .packet_filters import TRAFFIC

DOWN = ("down", "lowerlayerdown")  # operational states of an interface without a link
NOWHERE = "blackhole"


class ActualWorld:
    """The world as it was read, with some known faults."""

    def __init__(self, state: FleetState, faults: Iterable[Component]) -> None:
        self._state = state
        self._faults = [component for component in faults if component.kind in KINDS]
        self._world = _make_world(state, self._faults) if self._faults else None

    def find_fault(self, sender: str, target: str, traffic: str) -> Component | None:
        """Return the known fault at whose place a packet of this kind ends, or its answer; None if both arrive."""
        ways, world = self._state.ways, self._world
        member, own = ways.members.get(target), ways.members.get(sender)
        if member is None or world is None or sender not in world.machines or traffic not in TRAFFIC:
            return None
        datagram = TRAFFIC[traffic] == "udp"
        packet = self._state.filters.make_packet(member, "udp" if datagram else traffic)
        source = own.discovery_address if datagram and own else None
        end = packets.echo(world, sender, replace(packet, source=source)).failure
        if end is None:
            return None
        asked = str(end.hops[-1].to) if end.outcome == packets.NOBODY and end.hops else ""
        places = (end.where, ways.name_at(asked))
        return next((component for place in places for component in self._faults if place in component.places), None)


def _make_world(state: FleetState, faults: Sequence[Component]) -> World:
    planned = state.filters.world
    machines = {
        name: _read_machine(state.fleet, planned.machines[name], computer)
        for name, computer in state.run.items()
        if computer.interfaces and name in planned.machines
    }
    world = World({**planned.machines, **machines}, planned.links)
    for component in faults:
        change, machine = CHANGES.get((component.kind, component.mode)), world.machines.get(component.place)
        if (component.kind, component.mode) == DEAD:
            world = _cut_network(world, component.place)
        elif change and machine:
            world = world.replace_machine(change(state.fleet, machine, component))
    return facts.merge_links(state.fleet, world)


def _read_machine(fleet: FleetPlan, machine: Machine, computer: Participant) -> Machine:
    """Return the machine with the values that were read there; as planned, if the texts make no sense."""
    try:
        interfaces = tuple(_read_interface(fleet, machine.name, entry) for entry in computer.interfaces)
    except ValueError:
        return machine
    return replace(machine, interfaces=interfaces, routes=_list_routes(computer.plan, interfaces))


def _read_interface(fleet: FleetPlan, host: str, entry: ForwardingInterface) -> Interface:
    """Read an interface. Raises ValueError for strange texts, and if the prefix lengths were not read."""
    addresses = [IPv4Interface(f"{one}/{size}") for one, size in zip(entry.addresses, entry.prefixes, strict=True)]
    return Interface(
        name=entry.interface,
        addresses=tuple(addresses),
        link=facts.find_link(fleet, host, entry.interface, [address.ip for address in addresses]),
        mtu=entry.mtu or 1500,
        up=entry.state not in DOWN,
        forwarding=entry.forwarding != 0,
        rp_filter=entry.rp_filter or 0,
    )


def _list_routes(plan: ComputerPlan, interfaces: Sequence[Interface]) -> tuple[Route, ...]:
    return (*kernel_routes(*interfaces), *plan_world.list_routes(plan, [one for one in interfaces if one.up]))


# The faults

Change = Callable[[FleetPlan, Machine, Component], Machine]


def _cut_network(world: World, name: str) -> World:
    link = world.links.get(name)
    return replace(world, links={**world.links, name: replace(link, up=False)}) if link else world


def _switch_off(_fleet: FleetPlan, machine: Machine, _component: Component) -> Machine:
    return replace(machine, on=False)


def _cut_link(_fleet: FleetPlan, machine: Machine, component: Component) -> Machine:
    """Take an interface down, of a device without a probe, too."""
    interfaces = [replace(one, up=False) if component.what in ("", one.link) else one for one in machine.interfaces]
    return replace(machine, interfaces=tuple(interfaces))


def _close_routes(machine: Machine, networks: Iterable[IPv4Network]) -> Machine:
    """Take away the ways to networks: the packets go to a place that does not pass them on."""
    closed = [Route(network, kind=NOWHERE) for network in networks]
    return replace(machine, routes=(*closed, *machine.routes))


def _lose_route(fleet: FleetPlan, machine: Machine, component: Component) -> Machine:
    """Take away the way to a network, or to all others."""
    own = {address.network for one in machine.interfaces for address in one.addresses}
    gone = (network for network, link in fleet.network_names.items() if component.what in ("", link))
    return _close_routes(machine, (network for network in gone if network not in own))


def _close_address(_fleet: FleetPlan, machine: Machine, component: Component) -> Machine:
    """Close the way to the destination of a closed route, such as "blackhole 192.168.12.0/24 table 7"."""
    try:
        return _close_routes(machine, [IPv4Network(component.what.split()[1].replace("default", "0.0.0.0/0"))])
    except (ValueError, IndexError):
        return machine


def _lose_neighbour(fleet: FleetPlan, machine: Machine, component: Component) -> Machine:
    """Close the routes by a neighbour whose hardware address is wrong."""
    plan = fleet.computers.get(component.what)
    own = {entry.address for entry in plan.networks} if plan else set()
    routes = tuple(replace(one, kind=NOWHERE) if one.gateway in own else one for one in machine.routes)
    return _close_routes(replace(machine, routes=routes), map(IPv4Network, own))


DEAD = ("network", "dead")
# The needs of the packets of a world, besides the interfaces, rules and filters that were read.
CHANGES: Mapping[tuple[str, str], Change] = {
    ("computer", "off"): _switch_off,
    ("link", "down"): _cut_link,
    ("route", "missing"): _lose_route,
    ("route", "other"): _lose_route,
    ("route", "closed"): _close_address,
    ("neighbour", "fixed"): _lose_neighbour,
}
# The kinds of components at whose place a packet may end.
KINDS = frozenset({"interface", "forwarding", "reverse_path", "filter", "network", *(kind for kind, _mode in CHANGES)})
