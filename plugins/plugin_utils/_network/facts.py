# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The world of facts: machines as `multimaster_info` read them, now and after site.yml.

A machine without facts is taken as planned. The addresses of an interface show its link.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from ipaddress import IPv4Address, IPv4Interface, IPv4Network
from typing import Any

from .._base.plain import from_plain
from .._base.plain_text import quote
from .._plan.model import ComputerPlan, FleetPlan
from . import plan_world
from .model import ACCEPT, FORWARD, IN, LOOSE, NAT, OUT, Interface, Link, Machine, Route, Rule, World, kernel_routes
from .policy import lookups

Info = Mapping[str, Any]  # the return of multimaster_info

# The parts of multimaster_info that a machine needs to be more than its plan.
NEEDED = ("interfaces", "routing", "forwarding", "filters")
HOOKS = {"input": IN, "output": OUT, "forward": FORWARD, "postrouting": NAT}


def read_machines(fleet: FleetPlan, infos: Mapping[str, Info]) -> dict[str, Machine]:
    """Read the machines of which all facts are there, in the expected form: a computer may send anything."""
    machines = {}
    for name, info in infos.items():
        try:
            if all(info.get(part) for part in NEEDED):
                machines[name] = _machine(fleet, fleet.computers[name], info)
        except (LookupError, TypeError, ValueError, AttributeError):
            continue
    return machines


def join_world(fleet: FleetPlan, machines: Mapping[str, Machine]) -> World:
    """Make the world as it is now, with the machines that were read."""
    world = plan_world.make_world(fleet)
    links = {one.link for machine in machines.values() for one in machine.interfaces}
    world = World({**world.machines, **machines}, {**{name: Link(name) for name in links if name}, **world.links})
    return merge_links(fleet, world)


def apply_plan(fleet: FleetPlan, now: World, names: Iterable[str]) -> World:
    """Make the world after site.yml: the settings, routes and packet filter of these machines, which were read."""
    for name in names:
        now = now.replace_machine(_apply(fleet, fleet.computers[name], now.machines[name]))
    return now


# The values that were read


def _machine(fleet: FleetPlan, plan: ComputerPlan, info: Info) -> Machine:
    settings = {entry["interface"]: entry for entry in info["forwarding"]["interfaces"]}
    interfaces = tuple(
        _interface(fleet, plan.computer, entry, settings.get(entry["name"], {}))
        for entry in info["interfaces"]
        if not entry["loopback"]
    )
    own = plan_world.make_rules(fleet, plan) if any("firewall" in name for name in info.get("owned", ())) else ()
    rules, unclear = read_rules(info["filters"]["chains"])
    return Machine(
        name=plan.computer,
        interfaces=interfaces,
        routes=tuple(map(_route, info["routing"]["routes"])),
        lookups=lookups(info["routing"].get("rules", ())),
        tables={entry["table"]: tuple(map(_route, entry["routes"])) for entry in info["routing"].get("tables", ())},
        rules=(*own, *rules),
        unclear=unclear,
    )


def _interface(fleet: FleetPlan, host: str, entry: Info, settings: Info) -> Interface:
    addresses = tuple(
        IPv4Interface(f"{address['address']}/{address['prefix']}")
        for address in entry["addresses"]
        if address["family"] == "inet"
    )
    return Interface(
        name=entry["name"],
        addresses=addresses,
        link=find_link(fleet, host, entry["name"], (address.ip for address in addresses)),
        mtu=entry["mtu"] or 1500,
        up=entry["up"],
        forwarding=bool(settings.get("forwarding")),
        rp_filter=settings.get("rp_filter") or 0,
    )


def find_link(fleet: FleetPlan, host: str, device: str, addresses: Iterable[IPv4Address]) -> str:
    """Name the link of an interface: the planned network with its address, or else a link of its own.

    An interface with an address in the network of another robot alone, such as a bridge of containers, does not lead there.
    """
    near = list(_list_networks(fleet, addresses))
    plan = fleet.computers[host]
    own = {fleet.common_network, *(entry.network for entry in plan.networks)}
    leads_there = plan.is_router or len(set(near)) > 1 or not own.isdisjoint(near)
    return fleet.network_names[near[0]] if near and leads_there else f"{quote(device)} of {host}"


def _list_networks(fleet: FleetPlan, addresses: Iterable[IPv4Address]) -> Iterator[IPv4Network]:
    """List the planned networks that have these addresses."""
    return (network for address in addresses for network in fleet.network_names if address in network)


def _route(entry: Info) -> Route:
    # A next hop may be of IPv6 (RFC 5549): then no address is given.
    addresses = {name: "" if ":" in entry[name] else entry[name] for name in ("gateway", "source")}
    texts = {name: entry[name] for name in ("destination", "device", "metric")}
    return from_plain(Route, {**texts, **addresses, "kind": entry["type"]})


def read_rules(chains: Iterable[Info]) -> tuple[tuple[Rule, ...], frozenset[str]]:
    """Make the rules of the chains; the policy of each is its last rule. Return them, and the chains with rules that say more."""
    rules, unclear = [], set()
    for number, chain in enumerate(chains):
        hook, table = HOOKS[chain["hook"]], f"{number} {chain['table']}"
        own = [_rule(hook, table, entry, f"{chain['table']} {entry.get('chain', '')}") for entry in chain["rules"]]
        rules += own
        unclear |= {hook} if chain["unread"] else set()
        if chain["policy"] != ACCEPT:
            base = [f"{chain['table']} {chain['chain']}"] if chain.get("chain") else []
            origins = dict.fromkeys([*base, *(origin for rule in own for origin in rule.origins)])
            rules.append(Rule(hook, chain["policy"], table=table, origins=tuple(origins)))
    return tuple(rules), frozenset(unclear)


def _rule(hook: str, table: str, entry: Info, origin: str) -> Rule:
    first, last = entry.get("ports") or (0, 65535)
    place = {"chain": hook, "table": table, "origins": (origin,)}
    return from_plain(Rule, {**entry, **place, "ports": (first, last)})


def merge_links(fleet: FleetPlan, world: World) -> World:
    """Make one link of the links that an interface has addresses of: they are one wire. One that is down stays separate, as the place where packets end."""
    names = {name: name for name, link in world.links.items() if link.up}  # the name of the wire of each link
    for machine in world.machines.values():
        for one in machine.interfaces:
            links = (fleet.network_names[near] for near in _list_networks(fleet, (entry.ip for entry in one.addresses)))
            wire = {names[link] for link in links if link in names}
            if len(wire) > 1:
                names = {link: min(wire) if name in wire else name for link, name in names.items()}
    for machine in world.machines.values():
        interfaces = tuple(replace(one, link=names.get(one.link, one.link)) for one in machine.interfaces)
        if interfaces != machine.interfaces:
            world = world.replace_machine(replace(machine, interfaces=interfaces))
    return world


# The changes of site.yml


def _add_interfaces(fleet: FleetPlan, plan: ComputerPlan, machine: Machine) -> Machine:
    """Add the interfaces that optional features make, if they are not there yet."""
    for planned in plan.interfaces_to_come:
        if any(one.name == planned.name for one in machine.interfaces):
            continue
        address = IPv4Interface(f"{planned.address}/{planned.network.prefixlen}")
        link = fleet.network_names.get(planned.network, "")
        interface = Interface(name=planned.name, addresses=(address,), link=link, mtu=planned.mtu, up=True)
        routes = (*machine.routes, *kernel_routes(interface))
        machine = replace(machine, interfaces=(*machine.interfaces, interface), routes=routes)
    return machine


def _apply(fleet: FleetPlan, plan: ComputerPlan, machine: Machine) -> Machine:
    machine = _add_interfaces(fleet, plan, machine)
    interfaces = machine.interfaces
    if plan.forwards:
        interfaces = tuple(replace(one, forwarding=True, rp_filter=LOOSE) for one in interfaces)
    others = [rule for rule in machine.rules if rule.table]
    return replace(
        machine,
        interfaces=interfaces,
        routes=_routes(plan, machine),
        rules=(*plan_world.make_rules(fleet, plan), *others),
    )


def _routes(plan: ComputerPlan, machine: Machine) -> tuple[Route, ...]:
    """Return the routes with those of the plan. A planned route replaces one with its destination and metric 0."""
    routes = plan_world.list_routes(replace(plan, routes_expected=()), [one for one in machine.interfaces if one.up])
    places = {route.destination for route in routes}
    others = [route for route in machine.routes if route.destination not in places or route.metric]
    return (*routes, *others)
