# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The way of a packet: hop by hop, as a kernel decides it. A question and its answer are two ways.

Pure: a world and a packet in, a trace out. Nothing is a matter of chance.
"""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from ipaddress import IPv4Address
from typing import NamedTuple

from .model import FORWARD, IN, MASQUERADE, NAT, NO_WAY, OUT, REJECT, STRICT, Cause, Interface, Machine, Packet, World

# The outcomes of a packet
DELIVERED = "delivered"
NO_ROUTE = "no route"
CLOSED = "closed"  # a rule or a route that leads nowhere
NO_ADDRESS = "no address"
OFF = "off"
DOWN = "down"
NOBODY = "nobody"
LINK_DOWN = "link down"
APART = "apart"
FILTERED = "filtered"
REJECTED = "rejected"
NOT_FORWARDED = "not forwarded"
REVERSE_PATH = "reverse path"
TOO_LARGE = "too large"
CIRCLE = "circle"
ELSEWHERE = "elsewhere"

TTL = 64  # machines that pass a packet on


class _PacketEnd(Exception):
    """The end of a packet: the outcome, and the place."""

    def __init__(self, outcome: str, where: str, rule: Cause | None = None) -> None:
        super().__init__(outcome, where)
        self.outcome, self.where, self.rule = outcome, where, rule


class Hop(NamedTuple):
    """A machine that a packet passes, and the interface by which it leaves."""

    machine: str
    device: str = ""
    to: IPv4Address | None = None  # the next machine; None at the end


@dataclass
class Trace:
    """The way of a packet. `where` is the machine or the link at which it ends, `by` the last machine that had it."""

    packet: Packet  # as it is at the end: a translated source is the new one
    by: str
    world: World
    known: Mapping[tuple[str, IPv4Address], IPv4Address]  # translations that are undone
    outcome: str = ""
    where: str = ""
    hops: list[Hop] = field(default_factory=list)
    # machine, new source, the one before
    translations: list[tuple[str, IPv4Address, IPv4Address]] = field(default_factory=list)
    device: str = ""  # by which it came in at its end
    rule: Cause | None = None  # that ends it

    @property
    def ok(self) -> bool:
        """True if it arrived."""
        return self.outcome == DELIVERED

    def run(self, machine: Machine) -> None:
        """Follow the packet from a machine to its end."""
        try:
            if not machine.on:
                raise _PacketEnd(OFF, machine.name)
            if self._local(machine):
                self.hops.append(Hop(machine.name))
                raise _PacketEnd(DELIVERED, machine.name)
            machine, interface = self._leave(machine, None)
            for unused in range(TTL):
                machine, interface = self._arrive(machine, interface)
            raise _PacketEnd(CIRCLE, self.by)
        except _PacketEnd as end:
            self.outcome, self.where, self.rule = end.outcome, end.where, end.rule

    def _local(self, machine: Machine) -> bool:
        destination = self.packet.destination
        if destination not in machine.addresses and not destination.is_loopback:
            return False
        if self.packet.source is None:
            self.packet = replace(self.packet, source=destination)
        return True

    def _leave(self, machine: Machine, incoming: Interface | None) -> tuple[Machine, Interface]:
        """Send the packet from a machine to the next one."""
        route = machine.route(self.packet, incoming.name if incoming else "")
        if route is None:
            raise _PacketEnd(NO_ROUTE, machine.name)
        if route.kind in NO_WAY:
            raise _PacketEnd(REJECTED if route.kind == "prohibit" else CLOSED, machine.name, route.rule)
        device, hop = machine.interface(route.device), route.gateway or self.packet.destination
        if incoming is None:
            source = self.packet.source or machine.source(route, self.packet.destination)
            if source is None:
                raise _PacketEnd(NO_ADDRESS, machine.name)
            self.packet = replace(self.packet, source=source)
            self._filter(machine, OUT, "", device.name)
        else:
            self._filter(machine, FORWARD, incoming.name, device.name)
        self._translate(machine, device)
        self.hops.append(Hop(machine.name, device.name, hop))
        if self.packet.size > device.mtu and self.packet.whole:
            raise _PacketEnd(TOO_LARGE, machine.name)
        return self._cross(machine, device, hop)

    def _cross(self, machine: Machine, device: Interface, hop: IPv4Address) -> tuple[Machine, Interface]:
        """Cross a link, as one packet or as fragments that fit."""
        link = self.world.links.get(device.link)
        if link is None or not link.up:
            raise _PacketEnd(LINK_DOWN, device.link or machine.name)
        following, interface = _neighbour(self.world, machine, device, hop)
        if link.apart:
            raise _PacketEnd(APART, link.name)
        size = min(self.packet.size, device.mtu)
        if link.largest is not None and size > link.largest:
            raise _PacketEnd(TOO_LARGE, link.name)
        if size > interface.mtu:
            raise _PacketEnd(TOO_LARGE, following.name)
        return following, interface

    def _arrive(self, machine: Machine, interface: Interface) -> tuple[Machine, Interface]:
        """Take the packet in at a machine: it ends there, or goes on to the next one."""
        self.by, self.device = machine.name, interface.name
        packet = self.packet
        if interface.rp_filter and packet.source is not None:
            answer = Packet(packet.protocol, packet.source, packet.destination, packet.source_port, packet.port)
            back = machine.route(answer)
            if back is not None and back.rule is not None:
                raise _PacketEnd(CLOSED, machine.name, back.rule)
            if back is None or back.kind in NO_WAY or (interface.rp_filter == STRICT and back.device != interface.name):
                raise _PacketEnd(REVERSE_PATH, machine.name)
        before = self.known.get((machine.name, packet.destination)) if packet.answer else None
        if before is not None:
            packet = self.packet = replace(packet, destination=before)
        if packet.destination in machine.addresses:
            self.hops.append(Hop(machine.name))
            self._filter(machine, IN, interface.name, "")
            raise _PacketEnd(DELIVERED, machine.name)
        if not interface.forwarding:
            raise _PacketEnd(NOT_FORWARDED, machine.name)
        return self._leave(machine, interface)

    def _filter(self, machine: Machine, chain: str, incoming: str, leaving: str) -> None:
        rule = machine.find_blocking_rule(chain, self.packet, incoming, leaving)
        if rule is not None:
            raise _PacketEnd(REJECTED if rule.verdict == REJECT else FILTERED, machine.name, rule)

    def _translate(self, machine: Machine, device: Interface) -> None:
        source = self.packet.source
        if source is None or source in machine.addresses or not masquerades(machine, device, self.packet):
            return
        own = device.addresses[0].ip
        self.translations.append((machine.name, own, source))
        self.packet = replace(self.packet, source=own)


def masquerades(machine: Machine, device: Interface, packet: Packet) -> bool:
    """Return True if a packet gets the address of the interface by which it leaves. An answer never does."""
    rule = None if packet.answer else machine.find_blocking_rule(NAT, packet, leaving=device.name)
    return rule is not None and rule.verdict == MASQUERADE


def _neighbour(world: World, machine: Machine, device: Interface, hop: IPv4Address) -> tuple[Machine, Interface]:
    """Return the machine that answers for an address on a link. Raises _PacketEnd without an answer.

    If two machines have it, either may answer; here it depends on the machine that asks.
    """
    have = [(one, interface) for one, interface in world.holders(device.link, hop) if one.name != machine.name]
    answer = [(one, interface) for one, interface in have if one.on and interface.up]
    if answer:
        number = zlib.crc32(f"{machine.name} {hop}".encode()) if len(answer) > 1 else 0
        return answer[number % len(answer)]
    if have:
        raise _PacketEnd(DOWN if have[0][0].on else OFF, have[0][0].name)
    raise _PacketEnd(NOBODY, machine.name)


def trace(
    world: World, start: str, packet: Packet, known: Mapping[tuple[str, IPv4Address], IPv4Address] | None = None
) -> Trace:
    """Follow a packet from a machine. `known` are translations that are undone: (machine, address) -> the one before."""
    way = Trace(packet, start, world, known or {})
    way.run(world.machines[start])
    return way


@dataclass(frozen=True)
class Echo:
    """A question and its answer."""

    there: Trace
    back: Trace | None  # None if the question did not arrive

    @property
    def ok(self) -> bool:
        """True if the answer came back."""
        return self.failure is None

    @property
    def failure(self) -> Trace | None:
        """The way that did not arrive; None if both did."""
        return next((way for way in (self.there, self.back) if way is not None and not way.ok), None)


def echo(world: World, start: str, packet: Packet) -> Echo:
    """Follow a packet to its end, and its answer back: of a ping, or of the first packet of a connection."""
    there = trace(world, start, packet)
    arrived = there.packet
    if not there.ok or arrived.source is None:  # who has sent a packet has a source
        return Echo(there, None)
    answer = replace(
        packet,
        source=arrived.destination,
        destination=arrived.source,
        port=packet.source_port if packet.port else 0,
        source_port=packet.port,
        whole=packet.whole and packet.protocol != "icmp",  # a kernel may split its answer to a ping
        answer=True,
    )
    known = {(machine, new): before for machine, new, before in there.translations}
    back = trace(world, there.where, answer, known)
    if back.ok and back.where != start:
        back = replace(back, outcome=ELSEWHERE)
    return Echo(there, back)
