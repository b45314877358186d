# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The way of a datagram to a multicast group: link by link, with the routers that forward it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from ipaddress import IPv4Address
from typing import NamedTuple

from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._network.model import (
    FORWARD,
    IN,
    OUT,
    STRICT,
    Interface,
    Machine,
    Packet,
    World,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._network.packets import masquerades

from tests.simulator.state import ports


class Delivery(NamedTuple):
    """A datagram of a group that comes in at a machine."""

    machine: str
    device: str
    source: IPv4Address
    links: tuple[str, ...]
    kept: float = 1.0  # the share of such datagrams that no interface on the way loses


class _Copy(NamedTuple):
    """A datagram before it leaves a machine."""

    sender: str
    device: Interface
    packet: Packet
    links: tuple[str, ...]  # that it has crossed
    kept: float = 1.0


def send_to_group(world: World, start: str, source: IPv4Address, packet: Packet) -> list[Delivery]:
    """Return the deliveries of a datagram to a group. A machine sends it from the interface with `source`."""
    machine = world.machines[start]
    device = machine.find_interface(source)
    if device is None or not device.up:
        return []
    packet = replace(packet, source=source)
    if machine.find_blocking_rule(OUT, packet, leaving=device.name) is not None:
        return []
    deliveries: list[Delivery] = []
    waiting = [_Copy(machine.name, device, packet, ())]
    # A multicast router also forwards its own datagrams, which come back to it (IP_MULTICAST_LOOP).
    waiting += [_Copy(machine.name, other, packet, ()) for other in _list_exits(machine, device, packet)]
    crossed = set()
    while waiting:
        sender, leaves, sent, before, share = waiting.pop(0)
        if leaves.link in crossed:
            continue
        crossed.add(leaves.link)
        for other, interface in _hearers(world, sender, leaves, sent):
            links, kept = (*before, leaves.link), share * (1 - leaves.loss) * (1 - interface.loss)
            if other.find_blocking_rule(IN, sent, interface.name) is None and sent.source is not None:
                deliveries.append(Delivery(other.name, interface.name, sent.source, links, kept))
            for next_interface in _list_exits(other, interface, sent):
                waiting.append(
                    _Copy(other.name, next_interface, _translate_source(other, next_interface, sent), links, kept)
                )
    return deliveries


def _hearers(world: World, sender: str, device: Interface, packet: Packet) -> Iterator[tuple[Machine, Interface]]:
    """Yield the machines that a datagram reaches on one link."""
    link = world.links.get(device.link)
    if link is None or not link.up or link.apart or packet.destination in link.pruned:
        return
    if link.largest is not None and packet.size > link.largest:
        return
    for machine, interface in ports(world)[link.name]:
        if machine.on and interface.up and machine.name != sender and packet.size <= interface.mtu:
            if _has_way_back(machine, interface, packet):
                yield machine, interface


def _has_way_back(machine: Machine, interface: Interface, packet: Packet) -> bool:
    """Tell if the reverse-path filter lets a datagram in."""
    if not interface.rp_filter or packet.source is None:
        return True
    back = machine.route(replace(packet, source=packet.destination, destination=packet.source))
    return back is not None and (interface.rp_filter != STRICT or back.device == interface.name)


def _list_exits(machine: Machine, incoming: Interface, packet: Packet) -> list[Interface]:
    """Return the interfaces by which a multicast router forwards a datagram."""
    if (
        packet.destination not in machine.groups
        or machine.find_blocking_rule(FORWARD, packet, incoming.name) is not None
    ):
        return []
    return [one for one in machine.interfaces if one.up and one.name != incoming.name]


def _translate_source(machine: Machine, device: Interface, packet: Packet) -> Packet:
    return replace(packet, source=device.addresses[0].ip) if masquerades(machine, device, packet) else packet
