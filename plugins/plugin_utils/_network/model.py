# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""A world as types: machines with their interfaces, routes and filters, and the links between them.

A world has all that decides about the way of packets. `plan_world` makes it of a plan, `facts` of the facts of machines. `packets.trace`
sends packets through it. Nothing here changes: `dataclasses.replace` makes a new world.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from ipaddress import IPv4Address, IPv4Interface, IPv4Network

LOOSE, STRICT = 2, 1  # values of rp_filter (kernel: Documentation/networking/ip-sysctl)
NO_WAY = ("blackhole", "unreachable", "prohibit", "throw")  # kinds of routes that lead nowhere (ip-route(8))

# The chains of a packet filter, and the one that translates sources
IN, OUT, FORWARD, NAT = "in", "out", "forward", "nat"
MASQUERADE = "masquerade"
ACCEPT, DROP, REJECT = "accept", "drop", "reject"  # rejected as firewalld does it, with "administratively prohibited"


@dataclass(frozen=True)
class Packet:
    """A packet of IPv4 to one computer, or to a group."""

    protocol: str  # icmp, tcp or udp
    destination: IPv4Address
    source: IPv4Address | None = None  # None: chosen by the route
    port: int = 0
    source_port: int = 40000
    size: int = 100  # bytes, with all headers
    whole: bool = False  # it must not be cut into fragments
    answer: bool = False  # to an earlier packet: a filter that follows connections lets it pass


@dataclass(frozen=True)
class Interface:
    """An interface of a machine."""

    name: str
    addresses: tuple[IPv4Interface, ...] = ()
    link: str = ""  # the wire or cell that it is in
    mtu: int = 1500
    up: bool = True
    forwarding: bool = False  # of packets that come in here
    rp_filter: int = 0  # the larger value of `all` and the interface


@dataclass(frozen=True)
class Route:
    """A route of the main table."""

    destination: IPv4Network
    gateway: IPv4Address | None = None
    device: str = ""
    metric: int = 0
    source: IPv4Address | None = None
    kind: str = "unicast"
    rule: Lookup | None = None  # of policy routing, that leads nowhere itself


ANY_PORT = (0, 65535)
MAIN, MAIN_PRIORITY = "main", 32766  # the table that counts if no rule says anything else (ip-rule(8))


@dataclass(frozen=True)
class Lookup:
    """A rule of policy routing: which table is asked for which packets, the one with the lowest priority first."""

    priority: int
    table: str = MAIN
    source: IPv4Network | None = None  # None: any; a packet without an address yet is from none
    destination: IPv4Network | None = None
    incoming: str = ""  # the interface by which a packet comes in, lo for packets that are sent here
    kind: str = ""  # of NO_WAY: it leads nowhere itself
    longer: int = -1  # only routes with a longer prefix count (suppress_prefixlength)
    protocol: str = ""
    ports: tuple[int, int] = ANY_PORT  # of the destination, the first and the last one
    source_ports: tuple[int, int] = ANY_PORT

    def matches(self, packet: Packet, incoming: str) -> bool:
        """Return True if this rule is for a packet."""
        return (
            (self.destination is None or packet.destination in self.destination)
            and (self.source is None or (packet.source is not None and packet.source in self.source))
            and self.incoming in ("", incoming or "lo")
            and self.protocol in ("", packet.protocol)
            and self.ports[0] <= packet.port <= self.ports[1]
            and self.source_ports[0] <= packet.source_port <= self.source_ports[1]
        )


NEW, ANSWER = "new", "answer"  # the states that a filter that follows connections distinguishes


@dataclass(frozen=True)
class Rule:
    """A rule of a packet filter. A field that is left out matches everything, and the first rule of a table that matches decides."""

    chain: str
    verdict: str
    protocol: str = ""
    ports: tuple[int, int] = ANY_PORT  # of the destination, the first and the last one
    sources: tuple[IPv4Network, ...] = ()
    destinations: tuple[IPv4Network, ...] = ()
    incoming: str = ""  # the interface by which a packet comes in
    leaving: str = ""  # the interface by which it leaves
    state: str = ""  # NEW: the first packet of an exchange; ANSWER: the rest
    above: int = 0  # only packets with more bytes
    table: str = ""  # a packet has to pass the chain of each table
    origins: tuple[
        str, ...
    ] = ()  # "family table chain" in which it is; of a policy its chain first, and those of all rules before it

    def matches(self, packet: Packet, incoming: str, leaving: str) -> bool:
        """Return True if this rule is for a packet."""
        return (
            self.protocol in ("", packet.protocol)
            and self.ports[0] <= packet.port <= self.ports[1]
            and self.state in ("", ANSWER if packet.answer else NEW)
            and packet.size > self.above
            and self.incoming in ("", incoming)
            and self.leaving in ("", leaving)
            and _is_in(packet.source, self._sources)
            and _is_in(packet.destination, self._destinations)
        )

    @cached_property
    def _sources(self) -> Networks:
        return _sort_by_mask(self.sources)

    @cached_property
    def _destinations(self) -> Networks:
        return _sort_by_mask(self.destinations)


Networks = Mapping[
    int, Collection[int]
]  # by mask. A rule has each computer of the fleet, and each pair of them asks it


def _sort_by_mask(networks: Iterable[IPv4Network]) -> Networks:
    found: dict[int, set[int]] = {}
    for network in networks:
        found.setdefault(int(network.netmask), set()).add(int(network.network_address))
    return found


def _is_in(address: IPv4Address | None, networks: Networks) -> bool:
    if not networks or address is None:
        return not networks
    number = int(address)
    return any(number & mask in numbers for mask, numbers in networks.items())


Cause = Rule | Lookup  # of the end of a packet: a rule of the packet filter, or for routing
Table = Mapping[int, Mapping[int, Route]]  # by mask, the most special one first, and by network


def _look_up(table: Table, destination: IPv4Address) -> Route | None:
    number = int(destination)
    return next((routes[number & mask] for mask, routes in table.items() if number & mask in routes), None)


@dataclass(frozen=True)
class Machine:
    """A computer or another device, as far as packets depend on it."""

    name: str
    interfaces: tuple[Interface, ...] = ()
    routes: tuple[Route, ...] = ()  # the whole main table, with the kernel's own routes for each address
    lookups: tuple[Lookup, ...] = ()  # besides the kernel's own
    tables: Mapping[str, tuple[Route, ...]] = field(default_factory=dict)  # the other tables that these ask
    rules: tuple[Rule, ...] = ()
    unclear: frozenset[str] = frozenset()  # chains with rules that are not among `rules`, since they say more
    on: bool = True

    @cached_property
    def _ports(self) -> Mapping[str, Interface]:
        return {interface.name: interface for interface in self.interfaces}

    @cached_property
    def addresses(self) -> frozenset[IPv4Address]:
        """Its own addresses, without those of interfaces that are down."""
        return frozenset(address.ip for interface in self.interfaces if interface.up for address in interface.addresses)

    @cached_property
    def _tables(self) -> Mapping[str, Table]:
        return {name: self._sort_routes(routes) for name, routes in {**self.tables, MAIN: self.routes}.items()}

    def _sort_routes(self, routes: Sequence[Route]) -> Table:
        """Return the routes by mask and network as numbers: each packet asks this, and a gateway has a route to each other robot."""
        up = {interface.name for interface in self.interfaces if interface.up}
        usable = [route for route in routes if route.kind in NO_WAY or route.device in up]
        table: dict[int, dict[int, Route]] = {}
        for route in sorted(usable, key=lambda route: (-route.destination.prefixlen, route.metric)):
            network = int(route.destination.network_address)
            table.setdefault(int(route.destination.netmask), {}).setdefault(network, route)
        return table

    def interface(self, name: str) -> Interface:
        """Return the interface with this name."""
        return self._ports[name]

    def find_interface(self, address: IPv4Address) -> Interface | None:
        """Return the interface with this address."""
        return next((one for one in self.interfaces if any(entry.ip == address for entry in one.addresses)), None)

    def route(self, packet: Packet, incoming: str = "") -> Route | None:
        """Return the route of a packet: the longest prefix counts, then the lowest metric. Rules may lead to other tables."""
        if not self.lookups:
            return _look_up(self._tables[MAIN], packet.destination)
        for rule in sorted((*self.lookups, Lookup(MAIN_PRIORITY)), key=lambda rule: rule.priority):
            if not rule.matches(packet, incoming):
                continue
            if rule.kind:
                return Route(IPv4Network("0.0.0.0/0"), kind=rule.kind, rule=rule)
            chosen = _look_up(self._tables.get(rule.table, {}), packet.destination)
            if chosen is not None and chosen.destination.prefixlen > rule.longer and chosen.kind != "throw":
                return chosen
        return None

    def source(self, route: Route, destination: IPv4Address) -> IPv4Address | None:
        """Return the source address on a route: the one in the network of the next hop, or else the first."""
        if route.source is not None:
            return route.source
        hop, own = route.gateway or destination, self.interface(route.device).addresses
        near = [entry.ip for entry in own if hop in entry.network]
        return next(iter(near or [entry.ip for entry in own]), None)

    @cached_property
    def _chains(self) -> Mapping[str, Sequence[Sequence[Rule]]]:
        """The rules of each chain, by table."""
        chains: dict[str, dict[str, list[Rule]]] = {}
        for rule in self.rules:
            chains.setdefault(rule.chain, {}).setdefault(rule.table, []).append(rule)
        return {chain: list(tables.values()) for chain, tables in chains.items()}

    def find_blocking_rule(self, chain: str, packet: Packet, incoming: str = "", leaving: str = "") -> Rule | None:
        """Return the blocking rule for a packet: that of the first table that does not accept it. None if all tables let it pass."""
        for rules in self._chains.get(chain, ()):
            match = next((rule for rule in rules if rule.matches(packet, incoming, leaving)), None)
            if match is not None and match.verdict != ACCEPT:
                return match
        return None


def kernel_routes(*interfaces: Interface) -> tuple[Route, ...]:
    """Return the routes that the kernel makes for the addresses of interfaces."""
    return tuple(
        Route(address.network, device=interface.name, source=address.ip)
        for interface in interfaces
        for address in interface.addresses
        if address.network.prefixlen < 32
    )


@dataclass(frozen=True)
class Link:
    """A wire, a switch or a wireless cell: a connection of interfaces without a router."""

    name: str
    up: bool = True
    largest: int | None = None  # bytes; a larger packet is lost without a word
    apart: bool = False  # an access point that keeps its clients apart


@dataclass(frozen=True)
class World:
    """All machines and links."""

    machines: Mapping[str, Machine]
    links: Mapping[str, Link]

    @cached_property
    def _holders(self) -> Mapping[tuple[str, IPv4Address], Sequence[tuple[Machine, Interface]]]:
        holders: dict[tuple[str, IPv4Address], list[tuple[Machine, Interface]]] = {}
        for machine in self.machines.values():
            for interface in machine.interfaces:
                for address in interface.addresses:
                    holders.setdefault((interface.link, address.ip), []).append((machine, interface))
        return holders

    def holders(self, link: str, address: IPv4Address) -> Sequence[tuple[Machine, Interface]]:
        """Return the machines with an address on a link, also those that are off."""
        return self._holders.get((link, address), ())

    def replace_machine(self, changed: Machine) -> World:
        """Return the world with a new state of one machine."""
        return replace(self, machines={**self.machines, changed.name: changed})
