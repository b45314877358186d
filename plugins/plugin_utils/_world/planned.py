# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The world that a plan makes: what every machine is after site.yml, if nothing else has its hands in.

Gateways and routers of another make are machines, too: their names are their addresses, as people know them.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from ipaddress import IPv4Address, IPv4Interface, IPv4Network

from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan.model import (
    ComputerPlan,
    FleetPlan,
    RobotNetwork,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._world.model import (
    ACCEPT,
    DROP,
    FORWARD,
    IN,
    LOOSE,
    NEW,
    Interface,
    Link,
    Machine,
    Route,
    Rule,
    World,
    connected,
)

COMMON = "the common network"
FIRST, LAST = 1024, 65535  # the ports that multimaster_firewall protects


def link_of(fleet: FleetPlan, network: IPv4Network) -> str:
    """Name the link of a planned network; empty for a network that is none."""
    if network == fleet.common_network:
        return COMMON
    return next((f"the network of {entry.robot}" for entry in fleet.networks if entry.network == network), "")


def planned(fleet: FleetPlan) -> World:
    """Make the world of a plan."""
    machines = [computer(fleet, plan) for plan in fleet.computers.values()] + devices(fleet)
    links = [COMMON, *(f"the network of {entry.robot}" for entry in fleet.networks)]
    return World({machine.name: machine for machine in machines}, {name: Link(name) for name in links})


def computer(fleet: FleetPlan, plan: ComputerPlan) -> Machine:
    """Make the machine of a computer's plan."""
    passes = plan.is_gateway or plan.is_router
    interfaces = tuple(
        Interface(
            name=f"eth{number}",
            addresses=(IPv4Interface((entry.address, entry.network.prefixlen)),),
            link=link_of(fleet, entry.network),
            forwarding=passes,
            rp_filter=LOOSE if passes else 0,
        )
        for number, entry in enumerate(plan.networks)
    )
    return Machine(
        name=plan.computer,
        interfaces=interfaces,
        routes=(*(route for interface in interfaces for route in connected(interface)), *own_routes(plan, interfaces)),
        rules=rules(fleet, plan),
        groups=groups(plan),
        names=names(fleet) if plan.robot else {},
        services=frozenset(plan.services),
        environment=plan.environment,
    )


def groups(plan: ComputerPlan) -> frozenset[IPv4Address]:
    """Return the groups that a computer passes on."""
    return frozenset({plan.multicast_routing.group} if plan.multicast_routing else ())


def own_routes(plan: ComputerPlan, interfaces: Sequence[Interface]) -> tuple[Route, ...]:
    """List the routes of a computer's plan, and those that something else is to make."""
    wanted = [(route.destination, route.gateway) for route in plan.routes]
    wanted += [(route.destination, route.gateways[0]) for route in plan.routes_expected]
    found = ((destination, gateway, _device(interfaces, gateway)) for destination, gateway in wanted)
    return tuple(Route(destination, gateway, device) for destination, gateway, device in found if device)


def _device(interfaces: Iterable[Interface], gateway: IPv4Address) -> str:
    """Name the interface on whose network a gateway is; empty for none."""
    near = (one.name for one in interfaces if any(gateway in address.network for address in one.addresses))
    return next(near, "")


def names(fleet: FleetPlan) -> dict[str, tuple[IPv4Address, ...]]:
    """Return what each name of the fleet means, on every computer."""
    return {name: (entry.address,) for entry in fleet.hosts_entries for name in entry.names}


def rules(fleet: FleetPlan, plan: ComputerPlan) -> tuple[Rule, ...]:
    """List the rules of the planned packet filter; none where none is planned."""
    if plan.firewall is None:
        return ()
    known = (*fleet.let_in, *plan.firewall.also)
    opened = [
        (protocol, int(port)) for port, _slash, protocol in (text.partition("/") for text in plan.firewall.open_ports)
    ]
    found = []
    for chain, networks in ((IN, ()), (FORWARD, plan.firewall.networks)):
        if chain == FORWARD and not networks:
            continue
        found.append(Rule(chain, ACCEPT, sources=known))
        found += [Rule(chain, ACCEPT, protocol, (port, port)) for protocol, port in opened]
        found += [
            Rule(chain, DROP, protocol, (FIRST, LAST), destinations=networks, state=NEW) for protocol in ("tcp", "udp")
        ]
    return tuple(found)


# Devices of another make


def devices(fleet: FleetPlan) -> list[Machine]:
    """List the gateways and the router that are no computers of the inventory, set up as docs/start/router.md says."""
    found = [_gateway(fleet, entry) for entry in fleet.networks if entry.device]
    router = fleet.router
    if router is not None and not router.name:
        found.append(_device_on(fleet, str(router.address), [(router.address, fleet.common_network)], ""))
    return found


def _gateway(fleet: FleetPlan, entry: RobotNetwork) -> Machine:
    addresses = [(entry.gateway, entry.network), (entry.common_address, fleet.common_network)]
    return _device_on(fleet, str(entry.gateway), addresses, entry.robot)


def _device_on(fleet: FleetPlan, name: str, addresses: list[tuple[IPv4Address, IPv4Network]], robot: str) -> Machine:
    interfaces = tuple(
        Interface(
            name=f"port{number}",
            addresses=(IPv4Interface((address, network.prefixlen)),),
            link=link_of(fleet, network),
            forwarding=True,
        )
        for number, (address, network) in enumerate(addresses)
    )
    common = interfaces[-1].name
    others = [Route(entry.network, entry.common_address, common) for entry in fleet.networks if entry.robot != robot]
    return Machine(
        name=name,
        interfaces=interfaces,
        routes=(*(route for interface in interfaces for route in connected(interface)), *others),
    )
