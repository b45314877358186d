# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The remedy at the place where packets would end, from the values that were read there. Pure: a plan, a world and a trace in, advices out.

A machine that was not looked at has interfaces of the plan with names of their own, so no command is made for it.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Iterator, Mapping
from dataclasses import replace
from ipaddress import IPv4Address
from typing import NamedTuple

from .._base import advice
from .._faults.fault import INVENTORY, Advice, Advices, hand, keep_settings
from .._network import packets, policy
from .._network.model import MASQUERADE, NO_WAY, Interface, Lookup, Machine, Route, Rule, World
from .._network.packets import Trace
from .._plan.model import FleetPlan

TRANSLATED = "translated"
WRITE = "until the program that makes the rules loads them again: write it there, too"
MAKER = "until the program that makes it runs again: take it out there, too"


class Scene(NamedTuple):
    """A packet that ends, in the world after site.yml; `known` are the machines that were read."""

    fleet: FleetPlan
    world: World
    known: Container[str]

    def find_interface_down(self, way: Trace) -> Interface | None:
        """Find the interface that is down, by which a machine without a route would send a packet of the plan."""
        machine, plan = self.world.machines[way.where], self.fleet.computers.get(way.where)
        target = way.packet.destination
        hops = [route.gateway for route in plan.routes if target in route.destination] if plan else []
        return next(
            (
                one
                for one in machine.interfaces
                if not one.up and any(hop in entry.network for hop in (*hops, target) for entry in one.addresses)
            ),
            None,
        )

    def find_closed_route(self, way: Trace) -> Route | None:
        """Find the route that leads nowhere, of a packet or back to its source: a kernel that filters reverse paths drops it then, too."""
        machine = self.world.machines[way.where]
        ends = [way.packet.destination, *([way.packet.source] if way.outcome == packets.REVERSE_PATH else [])]
        routes = (machine.route(replace(way.packet, destination=one)) for one in reversed(ends) if one is not None)
        return next((route for route in routes if route is not None and route.kind in NO_WAY), None)

    def advise(self, way: Trace, outcome: str, where: str) -> Advices:
        """Return the remedy for packets that end; nothing if no value says more than the row of the table."""
        make = _REMEDIES.get(outcome)
        machine = self.world.machines.get(where)
        if make is None or machine is None:
            return ()
        if where not in self.known and outcome != packets.NOBODY:
            return ()
        return tuple(make(self, machine, way))


def _run(machine: Machine, words: str, effect: str, *values: tuple[str, object]) -> Iterator[Advice]:
    """Yield a command, if each value has its form."""
    if made := advice.command(words, *values):
        yield Advice(machine.name, made, effect)


def _open_route(scene: Scene, machine: Machine, way: Trace) -> Iterator[Advice]:
    """Delete the rule or the route that leads nowhere."""
    if isinstance(way.rule, Lookup):
        yield from _run(machine, "ip rule del {}", MAKER, ("rule", policy.write_rule(way.rule)))
        return
    route = scene.find_closed_route(way)
    if route is not None and route in machine.routes:
        destination = str(route.destination) if route.destination.prefixlen else "default"
        yield from _run(machine, "ip route del {}", MAKER, ("route", f"{route.kind} {destination}"))


def _correct_address(scene: Scene, _machine: Machine, way: Trace) -> Iterator[Advice]:
    """Name the variable with the address that no computer has, and the address that its computer has in that network."""
    hop = way.hops[-1].to if way.hops else None
    for name, plan in scene.fleet.computers.items():
        for variable, address in (("address", plan.address), ("common_address", plan.common_address)):
            if hop is not None and address == hop:
                there = _find_address(scene, name, hop)
                words = f"{there}, which it has there" if there else "the address that it has there"
                yield Advice(INVENTORY, f"set multimaster_{variable} of {name} to {words}")


def _find_address(scene: Scene, name: str, planned: IPv4Address) -> IPv4Address | None:
    """Find the address of a computer in the network of a planned one."""
    networks = [network for network in scene.fleet.network_names if planned in network]
    return next(
        (
            entry.ip
            for one in (scene.world.machines[name].interfaces if name in scene.known else ())
            for entry in one.addresses
            if any(entry.ip in network for network in networks) and entry.ip != planned
        ),
        None,
    )


def _switch_on(scene: Scene, machine: Machine, way: Trace) -> Iterator[Advice]:
    own = scene.find_interface_down(way) if way.outcome == packets.NO_ROUTE else None
    hop = way.hops[-1].to if way.hops else None
    interface = own or (machine.find_interface(hop) if hop is not None else None)
    if interface is not None:
        yield from _run(machine, "ip link set dev {} up", "", ("device", interface.name))


def _accept(scene: Scene, machine: Machine, way: Trace) -> Iterator[Advice]:
    """Let all packets between the robots pass, before the rule that drops them."""
    if isinstance(way.rule, Rule) and way.rule.origins:
        yield from _accept_in(scene, machine, way.rule.origins[0])


def _accept_in(scene: Scene, machine: Machine, chain: str) -> Iterator[Advice]:
    if made := advice.accept_between(scene.fleet.network_names, chain):
        yield Advice(machine.name, made, WRITE)


def _stop_translating(scene: Scene, machine: Machine, _way: Trace) -> Iterator[Advice]:
    origins = dict.fromkeys(rule.origins[0] for rule in machine.rules if rule.verdict == MASQUERADE and rule.origins)
    for origin in origins:
        yield from _accept_in(scene, machine, origin)


def _pass_on(_scene: Scene, machine: Machine, way: Trace) -> Iterator[Advice]:
    """Forward all packets, and those of the interface: it keeps a value of its own if ip_forward is 1 before."""
    if device := advice.format_value("device", way.device):
        own = f"net/ipv4/conf/{device}/forwarding"  # an interface may have dots in its name (sysctl(8))
        yield keep_settings("forwarding", {"net.ipv4.ip_forward": 1, own: 1})._replace(where=machine.name)


def _rename(_scene: Scene, machine: Machine, way: Trace) -> Iterator[Advice]:
    """Say which interface has the address of another machine."""
    interface = machine.find_interface(way.packet.destination)
    if interface is not None and (device := advice.format_value("device", interface.name)):
        yield hand(
            f"give {device} of {machine.name} another address than {way.packet.destination}, in its network manager or in DHCP"
        )


_REMEDIES: Mapping[str, Callable[[Scene, Machine, Trace], Iterator[Advice]]] = {
    packets.CLOSED: _open_route,
    packets.NOBODY: _correct_address,
    packets.DOWN: _switch_on,
    packets.FILTERED: _accept,
    packets.REJECTED: _accept,
    packets.NOT_FORWARDED: _pass_on,
    packets.ELSEWHERE: _rename,
    TRANSLATED: _stop_translating,
}
