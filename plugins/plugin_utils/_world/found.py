# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The world that was found: machines as `multimaster_info` has read them, now and after site.yml.

What nobody has looked at is taken as planned. Who is on which link follows from the addresses.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from ipaddress import IPv4Address, IPv4Interface, IPv4Network
from typing import Any

from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._fleet.plain_text import quote
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan.model import ComputerPlan, FleetPlan
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._world import planned
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._world.model import (
    ACCEPT,
    FORWARD,
    IN,
    LOOSE,
    NAT,
    OUT,
    Interface,
    Link,
    Machine,
    Route,
    Rule,
    World,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._world.policy import lookups

Info = Mapping[str, Any]  # the return of multimaster_info

# The parts of multimaster_info that a machine needs to be more than its plan.
NEEDED = ("interfaces", "routing", "forwarding", "filters")
HOOKS = {"input": IN, "output": OUT, "forward": FORWARD, "postrouting": NAT}


def looked_at(info: Info) -> bool:
    """Say if a machine was read."""
    return all(info.get(part) for part in NEEDED)


def makes_sense(fleet: FleetPlan, host: str, info: Info) -> bool:
    """Say if what was read can be understood: what a computer says may be anything."""
    try:
        _machine(fleet, fleet.computers[host], info)
    except (LookupError, TypeError, ValueError, AttributeError):
        return False
    return True


def found(fleet: FleetPlan, infos: Mapping[str, Info]) -> World:
    """Make the world as it is now."""
    world = planned.planned(fleet)
    machines = {name: _machine(fleet, fleet.computers[name], infos[name]) for name in infos if looked_at(infos[name])}
    links = {one.link for machine in machines.values() for one in machine.interfaces}
    world = World({**world.machines, **machines}, {**{name: Link(name) for name in links if name}, **world.links})
    return _one_wire(fleet, world)


def after(fleet: FleetPlan, now: World, infos: Mapping[str, Info]) -> World:
    """Make the world of now as site.yml would leave it: its settings, routes and packet filter."""
    for name, plan in fleet.computers.items():
        if name in infos and looked_at(infos[name]):
            now = now.with_machine(_applied(fleet, plan, now.machines[name]))
    return now


# What was read


def _machine(fleet: FleetPlan, plan: ComputerPlan, info: Info) -> Machine:
    settings = {entry["interface"]: entry for entry in info["forwarding"]["interfaces"]}
    interfaces = tuple(
        _interface(fleet, plan.computer, entry, settings.get(entry["name"], {}))
        for entry in info["interfaces"]
        if not entry["loopback"]
    )
    names = {one.name for one in interfaces}
    own = planned.rules(fleet, plan) if any("firewall" in name for name in info.get("owned", ())) else ()
    return Machine(
        name=plan.computer,
        interfaces=interfaces,
        routes=tuple(
            route for route in map(_route, info["routing"]["routes"]) if route.device in names or not route.device
        ),
        lookups=lookups(info["routing"].get("rules", ())),
        tables={entry["table"]: tuple(map(_route, entry["routes"])) for entry in info["routing"].get("tables", ())},
        rules=(*own, *rules(info["filters"]["chains"])),
        unclear=unclear(info["filters"]["chains"]),
        groups=planned.groups(plan)
        if any("multicast_routing" in name for name in info.get("owned", ()))
        else frozenset(),
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
        link=_link(fleet, host, entry["name"], (address.ip for address in addresses)),
        mtu=entry["mtu"] or 1500,
        up=entry["up"],
        forwarding=bool(settings.get("forwarding")),
        rp_filter=settings.get("rp_filter") or 0,
    )


def _link(fleet: FleetPlan, host: str, device: str, addresses: Iterable[IPv4Address]) -> str:
    """Name the link of an interface: that of the planned network which has its address, else one of its own."""
    networks = [fleet.common_network, *(entry.network for entry in fleet.networks)]
    near = [network for address in addresses for network in networks if address in network]
    return planned.link_of(fleet, near[0]) if near else f"{quote(device)} of {host}"


def _route(entry: Info) -> Route:
    return Route(
        destination=IPv4Network(entry["destination"]),
        gateway=_address(entry["gateway"]),
        device=entry["device"],
        metric=entry["metric"],
        source=_address(entry["source"]),
        kind=entry["type"],
    )


def _address(text: str) -> IPv4Address | None:
    """Read a next hop; None for none, and for one of IPv6 (RFC 5549)."""
    return IPv4Address(text) if text and ":" not in text else None


def rules(chains: Iterable[Info]) -> tuple[Rule, ...]:
    """Make the rules of the chains; the policy of each is its last rule."""
    made = []
    for number, chain in enumerate(chains):
        hook, table = HOOKS[chain["hook"]], f"{number} {chain['table']}"
        made += [_rule(hook, table, entry) for entry in chain["rules"]]
        if chain["policy"] != ACCEPT:
            made.append(Rule(hook, chain["policy"], table=table))
    return tuple(made)


def _rule(hook: str, table: str, entry: Info) -> Rule:
    first, last = entry.get("ports") or (0, 65535)
    return Rule(
        chain=hook,
        verdict=entry["verdict"],
        protocol=entry.get("protocol", ""),
        ports=(first, last),
        sources=tuple(map(IPv4Network, entry.get("sources", ()))),
        destinations=tuple(map(IPv4Network, entry.get("destinations", ()))),
        incoming=entry.get("incoming", ""),
        leaving=entry.get("leaving", ""),
        state=entry.get("state", ""),
        above=entry.get("above", 0),
        table=table,
    )


def unclear(chains: Iterable[Info]) -> frozenset[str]:
    """Name the chains with rules that are not among those of `rules`, since they say more than is understood."""
    return frozenset(HOOKS[chain["hook"]] for chain in chains if chain["unread"])


def _one_wire(fleet: FleetPlan, world: World) -> World:
    """Make one link of planned ones where an interface has addresses of several: they are one wire."""
    same: dict[str, str] = {}
    for machine in world.machines.values():
        for one in machine.interfaces:
            first, *more = dict.fromkeys(
                _link(fleet, machine.name, one.name, [entry.ip]) for entry in one.addresses
            ) or [""]
            same.update((other, same.get(first, first)) for other in more if other in world.links and other != first)
    moved = {name: _moved(machine, same) for name, machine in world.machines.items()}
    return replace(world, machines=moved) if same else world


def _moved(machine: Machine, same: Mapping[str, str]) -> Machine:
    return replace(
        machine, interfaces=tuple(replace(one, link=same.get(one.link, one.link)) for one in machine.interfaces)
    )


# What site.yml does


def _applied(fleet: FleetPlan, plan: ComputerPlan, machine: Machine) -> Machine:
    interfaces = machine.interfaces
    if any(setting.name == "net.ipv4.ip_forward" for setting in plan.sysctl):
        interfaces = tuple(replace(one, forwarding=True) for one in interfaces)
    if any(setting.name == "net.ipv4.conf.all.rp_filter" for setting in plan.sysctl):
        interfaces = tuple(replace(one, rp_filter=LOOSE) for one in interfaces)  # the larger value counts
    others = [rule for rule in machine.rules if rule.table]
    return replace(
        machine,
        interfaces=interfaces,
        routes=_routes(plan, machine),
        rules=(*planned.rules(fleet, plan), *others),
        groups=planned.groups(plan),
    )


def _routes(plan: ComputerPlan, machine: Machine) -> tuple[Route, ...]:
    """Return its routes with those of the plan, which take the place of others with their destination and metric 0."""
    wanted = planned.own_routes(replace(plan, routes_expected=()), [one for one in machine.interfaces if one.up])
    places = {route.destination for route in wanted}
    kept = [route for route in machine.routes if route.destination not in places or route.metric]
    return (*wanted, *kept)
