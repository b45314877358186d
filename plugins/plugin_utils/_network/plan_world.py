# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The world of a plan: the machines after site.yml, if nothing else changes them.

Gateways and routers of other makes are machines too. Their names are their addresses.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from ipaddress import IPv4Address, IPv4Interface, IPv4Network

from .._plan.model import ComputerPlan, FleetPlan
from .model import ACCEPT, DROP, FORWARD, IN, LOOSE, NEW, Interface, Link, Machine, Route, Rule, World, kernel_routes

FIRST, LAST = 1024, 65535  # the ports that multimaster_firewall protects


def make_world(fleet: FleetPlan) -> World:
    """Make the world of a plan."""
    machines = [make_machine(fleet, plan) for plan in fleet.computers.values()] + list_devices(fleet)
    links = {name: Link(name) for name in fleet.network_names.values()}
    return World({machine.name: machine for machine in machines}, links)


def make_machine(fleet: FleetPlan, plan: ComputerPlan) -> Machine:
    """Make the machine of a computer's plan."""
    passes = plan.forwards
    places = [(entry.address, entry.network) for entry in plan.networks]
    interfaces = _make_interfaces(fleet, "eth", places, passes, LOOSE if passes else 0)
    return Machine(
        name=plan.computer,
        interfaces=interfaces,
        routes=(*kernel_routes(*interfaces), *list_routes(plan, interfaces)),
        rules=make_rules(fleet, plan),
    )


def _make_interfaces(
    fleet: FleetPlan, name: str, places: Iterable[tuple[IPv4Address, IPv4Network]], forwarding: bool, rp_filter: int = 0
) -> tuple[Interface, ...]:
    """Make an interface for each address and its network."""
    return tuple(
        Interface(
            f"{name}{number}",
            (IPv4Interface((address, network.prefixlen)),),
            fleet.network_names.get(network, ""),
            forwarding=forwarding,
            rp_filter=rp_filter,
        )
        for number, (address, network) in enumerate(places)
    )


def list_routes(plan: ComputerPlan, interfaces: Sequence[Interface]) -> tuple[Route, ...]:
    """List the routes of a computer's plan, and the routes that it expects from others."""
    wanted = {route.destination: route.gateway for route in plan.routes}
    wanted |= {route.destination: route.gateways[0] for route in plan.routes_expected}
    for part in plan.features.values():
        wanted |= part.list_ways()
    devices = ((destination, gateway, _device(interfaces, gateway)) for destination, gateway in wanted.items())
    return tuple(Route(destination, gateway, device) for destination, gateway, device in devices if device)


def _device(interfaces: Iterable[Interface], gateway: IPv4Address) -> str:
    """Return the interface in the network of a gateway; empty if no interface is in it."""
    near = (one.name for one in interfaces if any(gateway in address.network for address in one.addresses))
    return next(near, "")


def make_rules(fleet: FleetPlan, plan: ComputerPlan) -> tuple[Rule, ...]:
    """List the rules of the planned packet filter, if there is one."""
    if plan.firewall is None:
        return ()
    known = (*fleet.let_in, *plan.firewall.also)
    opened = [
        (protocol, int(port)) for port, _slash, protocol in (text.partition("/") for text in plan.firewall.open_ports)
    ]
    rules = []
    for chain, networks in ((IN, ()), (FORWARD, plan.firewall.networks)):
        if chain == FORWARD and not networks:
            continue
        rules.append(Rule(chain, ACCEPT, sources=known))
        rules += [Rule(chain, ACCEPT, protocol, (port, port)) for protocol, port in opened]
        rules += [
            Rule(chain, DROP, protocol, (FIRST, LAST), destinations=networks, state=NEW) for protocol in ("tcp", "udp")
        ]
    return tuple(rules)


# Devices of another make


def list_devices(fleet: FleetPlan) -> list[Machine]:
    """List the gateways and the router that are not computers of the inventory, set up as docs/start/router.md says."""
    common, router = fleet.common_network, fleet.router
    devices = [
        _make_device(fleet, [(entry.gateway, entry.network), (entry.common_address, common)], entry.robot)
        for entry in fleet.networks
        if entry.device
    ]
    return devices if router is None or router.name else [*devices, _make_device(fleet, [(router.address, common)], "")]


def _make_device(fleet: FleetPlan, places: list[tuple[IPv4Address, IPv4Network]], robot: str) -> Machine:
    interfaces = _make_interfaces(fleet, "port", places, forwarding=True)
    common = interfaces[-1].name
    others = [Route(entry.network, entry.common_address, common) for entry in fleet.networks if entry.robot != robot]
    return Machine(str(places[0][0]), interfaces, routes=(*kernel_routes(*interfaces), *others))
