# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The view that computers have of each other's network: names, pings, routes, datagrams, TCP connections. Packets decide it all."""

from __future__ import annotations

import zlib
from dataclasses import fields, replace
from functools import lru_cache
from ipaddress import AddressValueError, IPv4Address

from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._network.model import NO_WAY, OUT, Packet, World
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._network.packets import (
    APART,
    CIRCLE,
    CLOSED,
    DOWN,
    LINK_DOWN,
    NO_ROUTE,
    NOBODY,
    OFF,
    REJECTED,
    TOO_LARGE,
    Trace,
    echo,
    trace,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observe import observations as seen
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observe.outcomes import Outcome

from tests.simulator.multicast import send_to_group
from tests.simulator.state import DEAD, loss

NODES = 45000  # stands for the ports of nodes, which the kernel chooses
CONTROL = 40000  # and this for the socket of a helper
SSH = 22
UNUSED = 9  # discard (RFC 863)
TRIES = 3
ATTEMPTS = 8  # of a connection, until the patience of the verification ends
PROBES = 20
ROUNDS = 2
LARGE = 1500
#: the end of a packet that ICMP reports; all others are an unreachable host
REPORTED = {
    NO_ROUTE: Outcome.NETWORK_UNREACHABLE,
    CLOSED: Outcome.NETWORK_UNREACHABLE,
    REJECTED: Outcome.PROHIBITED,
    CIRCLE: Outcome.TIME_EXCEEDED,
}
#: the errors of connections here
CONNECTED = {
    "": Outcome.OPEN,
    "Connection refused": Outcome.REFUSED,
    "Network is unreachable": Outcome.NETWORK_UNREACHABLE,
    "No route to host": Outcome.HOST_UNREACHABLE,
    "no answer within 2 s": Outcome.NO_ANSWER,
}
# The ICMP message of a router about a packet that ends there, in the words of the probes (RFC 792)
REPORTS = {
    NO_ROUTE: "network unreachable",
    CLOSED: "network unreachable",
    NOBODY: "host unreachable",
    OFF: "host unreachable",
    DOWN: "host unreachable",
    LINK_DOWN: "host unreachable",
    APART: "host unreachable",
    REJECTED: "communication administratively prohibited",
    CIRCLE: "time to live exceeded: the routers pass it round in a circle",
}


def report_end(world: World, start: str, way: Trace) -> str:
    """Return the text of the ICMP message to the sender, such as "192.168.1.201 reports: host unreachable"; or empty."""
    if way.outcome not in REPORTS or way.packet.source is None or way.packet.answer:
        return ""
    known = {(machine, new): before for machine, new, before in way.translations}
    message = trace(world, way.by, Packet("icmp", way.packet.source, answer=True), known)
    if not message.ok or message.where != start:
        return ""
    return f"{message.packet.source} reports: {REPORTS[way.outcome]}"


def _known(kind, **values):
    """Those of the values for which a type of the observations has a field."""
    names = {entry.name for entry in fields(kind)}
    return {name: value for name, value in values.items() if name in names}


class Network:
    """The network of a state, as its computers see it. `seed` decides which packets are lost."""

    def __init__(self, state, seed, there):
        self.there = there  # the computers where modules run
        self.state, self.fleet, self.world, self.seed = state, state.fleet, state.world, seed
        self.echo = lru_cache(None)(lambda start, packet: echo(self.world, start, packet))
        self.trace = lru_cache(None)(lambda start, packet: trace(self.world, start, packet))
        self.heard = lru_cache(None)(self._heard)
        self.connect = lru_cache(None)(self._connect)
        self.members = {member.name: member for member in self.fleet.members}

    def chance(self, *key):
        """A number from 0 to 1, the same for the same key."""
        number = zlib.crc32(f"{self.seed} {key}".encode())
        for shift, factor in (
            (16, 0x85EBCA6B),
            (13, 0xC2B2AE35),
        ):  # a checksum of similar texts is similar; this is MurmurHash3's end
            number = (number ^ number >> shift) * factor & 0xFFFFFFFF
        return (number ^ number >> 16) / 2**32

    # Names

    def resolve(self, computer, name, user=False):
        """The addresses that a name, or an address as text, has on a computer; for a `user` without rights."""
        try:
            return (IPv4Address(name),)
        except AddressValueError:
            pass
        if name.lower() == "localhost":
            return (IPv4Address("127.0.0.1"),)
        names = {} if user and computer in self.state.hidden else self.world.machines[computer].names
        return next((addresses for known, addresses in names.items() if known.lower() == name.lower()), ())

    # Echo requests

    def ping(self, computer, address):
        """The outcome of the probe for an address, after three tries."""
        way = self.echo(computer, Packet("icmp", address, size=28))
        lost = loss(self.world, way)
        if way.ok and any(self.chance("ping", computer, address, n) >= lost for n in range(TRIES)):
            return seen.Ping(True, 0.4 + round(self.chance(computer, address), 1), outcome=Outcome.ANSWERED)
        if not way.there.ok:
            machine = self.world.machines[computer]
            chosen = machine.route(Packet("icmp", address))
            if chosen is None or chosen.kind in NO_WAY:
                return seen.Ping(error="Network is unreachable", outcome=Outcome.NETWORK_UNREACHABLE)
            if machine.find_blocking_rule(OUT, way.there.packet, leaving=chosen.device) is not None:
                return seen.Ping(error="Operation not permitted", outcome=Outcome.FAILED)
        elif way.back is not None and way.back.ok and way.back.packet.source != address:  # somebody else's
            source = str(way.back.packet.source)
            return seen.Ping(error=f"the answer comes from {source}", outcome=Outcome.WRONG_SOURCE, reporter=source)
        if text := report_end(self.world, computer, way.there):
            outcome = REPORTED.get(way.there.outcome, Outcome.HOST_UNREACHABLE)
            return seen.Ping(error=text, outcome=outcome, reporter=text.partition(" reports")[0])
        return seen.Ping(error=f"no answer to {TRIES} requests", outcome=Outcome.NO_ANSWER)

    def route(self, computer, address):
        """The route of a computer's kernel to an address."""
        machine = self.world.machines[computer]
        chosen = machine.route(Packet("icmp", address))
        if chosen is None or chosen.kind in NO_WAY:
            return seen.TargetRoute(error="Network is unreachable")
        source, gateway = machine.source(chosen, address), chosen.gateway
        return seen.TargetRoute(chosen.device, str(source) if source else None, str(gateway) if gateway else None)

    def members_seen(self, computer, by_name):
        """Every member, as multimaster_verify looks at it."""
        found = []
        for member in self.fleet.members:
            addresses = self.resolve(computer, member.name) if by_name else ()
            error = "" if addresses else "Name or service not known" if by_name else "not looked up"
            entry = seen.SeenMember(member.name, str(member.address), tuple(map(str, addresses)), resolve_error=error)
            if by_name:
                known = self.resolve(computer, member.name, user=True)
                entry = replace(entry, user_addresses=tuple(map(str, known)))
            if member.name != computer:
                unknown = seen.Ping(error="the name has no address", outcome=Outcome.UNKNOWN_NAME)
                entry = replace(
                    entry,
                    route=self.route(computer, member.address),
                    discovery_route=(
                        self.route(computer, member.discovery_address)
                        if member.discovery_address not in (None, member.address)
                        else None
                    ),
                    ping_address=self.ping(computer, member.address),
                    ping_name=self.ping(computer, addresses[0]) if addresses else unknown,
                )
                entry = replace(entry, **_known(seen.SeenMember, **self.closer(computer, member.address, entry)))
            found.append(entry)
        return tuple(found)

    def closer(self, computer, address, entry):
        """The results of a closer look: the arrival of large packets, and the neighbour's hardware address."""
        there = self.echo(computer, Packet("icmp", address, size=28)).there
        near = entry.route.gateway is None and there.by != computer
        way = self.echo(computer, Packet("icmp", address, size=28))
        lost = loss(self.world, way) if way.ok else 1.0
        missed = sum(self.chance("more", computer, address, n) < lost for n in range(PROBES))
        found = {"neighbour": self.mac(there.by, there.device) if near else "", "loss": round(missed / PROBES, 3)}
        if entry.ping_address.ok:
            found["ping_large"] = self.large(computer, address, entry.route.device)
        else:
            error, _machine = self.connect(computer, address, UNUSED)
            found["tcp"] = "refused" if error == "Connection refused" else error
            found["tcp_outcome"] = CONNECTED[error]
            found["silent"] = not way.ok and entry.ping_address.outcome == Outcome.NO_ANSWER
        return found

    def claims(self, computer):
        """The computers that answer for the addresses of the fleet on the networks of a computer, and for its own."""
        found = []
        known = [
            address for plan in self.fleet.computers.values() for address in (entry.address for entry in plan.networks)
        ]
        known += [
            address for gateway in self.fleet.gateways.values() for address in (gateway.address, gateway.common_address)
        ]
        for interface in self.world.machines[computer].interfaces:
            link = self.world.links.get(interface.link)
            if not interface.up:
                continue
            own = [entry.ip for entry in interface.addresses]
            near = (address for address in known if any(address in entry.network for entry in interface.addresses))
            for address in dict.fromkeys([*own, *near]):
                there = [] if link is None or link.apart or not link.up else self.world.holders(interface.link, address)
                macs = [
                    self.mac(one.name, its.name) for one, its in there if one.name != computer and one.on and its.up
                ]
                found.append(seen.Claim(str(address), interface.name, tuple(macs)))
        return tuple(found)

    def large(self, computer, address, device):
        """Return True if a packet as large as the own interface takes arrives; a router that names the size that fits is as good."""
        size = min(LARGE, self.world.machines[computer].interface(device).mtu) if device else LARGE
        way = self.echo(computer, Packet("icmp", address, size=size, whole=True))
        lost = loss(self.world, way)
        end = way.there
        told = end.outcome == TOO_LARGE and end.where == end.by != computer
        if told or (way.ok and any(self.chance("large", computer, address, n) >= lost for n in range(TRIES))):
            return seen.Ping(True, 0.5, outcome=Outcome.ANSWERED)
        return seen.Ping(error=f"no answer to {TRIES} requests", outcome=Outcome.NO_ANSWER)

    def mac(self, machine, device):
        """The hardware address of an interface."""
        number = zlib.crc32(f"{machine} {device}".encode())
        return ":".join(f"{byte:02x}" for byte in (2, 0, *number.to_bytes(4, "big")))

    # The kernel

    def default_routes(self, computer):
        machine = self.world.machines[computer]
        return tuple(
            seen.DefaultRoute(route.device, None, str(route.gateway), str(route.metric) if route.metric else None)
            for route in machine.routes
            if route.destination.prefixlen == 0
        )

    def forwarding(self, computer):
        machine = self.world.machines[computer]
        interfaces = tuple(
            seen.ForwardingInterface(
                one.name,
                tuple(str(entry.ip) for entry in one.addresses),
                int(one.forwarding),
                one.rp_filter,
                int(not self.fleet.computers[computer].is_router),
                **_known(
                    seen.ForwardingInterface,
                    prefixes=tuple(entry.network.prefixlen for entry in one.addresses),
                    mtu=one.mtu,
                    mac=self.mac(computer, one.name),
                    state="up" if one.up and one.link and one.link not in self.state.unplugged else "down",
                ),
            )
            for one in machine.interfaces
            if one.addresses
        )
        return seen.ForwardingSettings(int(any(one.forwarding for one in machine.interfaces)), interfaces)

    # TCP

    def _connect(self, computer, address, port):
        """Open a TCP connection: an error or "", and the machine at its other end."""
        if address.is_loopback:
            return ("" if self.listens(computer, port) else "Connection refused"), computer
        way = self.echo(computer, Packet("tcp", address, port=port, size=60))
        if way.ok and self.chance("tcp", computer, address, port) >= loss(self.world, way) ** ATTEMPTS:
            there = way.there.where
            return ("" if self.listens(there, port) else "Connection refused"), there
        chosen = self.world.machines[computer].route(Packet("icmp", address))
        if chosen is None or chosen.kind in NO_WAY:
            return "Network is unreachable", ""
        told = report_end(self.world, computer, way.there)
        if told or way.there.outcome == REJECTED:
            return "No route to host", ""
        return "no answer within 2 s", ""

    def listens(self, machine, port):
        """Return True if a program listens on a TCP port."""
        if machine not in self.fleet.computers or not self.world.machines[machine].on:
            return False
        if port in (NODES, SSH):
            return True
        for robot, its in self.state.robots.items():
            if self.state.master(robot) == machine:
                plan = self.fleet.computers[machine]
                if port == plan.roscore_port and its.roscore != DEAD:
                    return True
                if port == self.fleet.master_of[robot].rpc_port and its.discovery != DEAD:
                    return True
        return False

    def carries(self, server, client_address):
        """Return True if a large answer of a server arrives: the kernel finds the size that fits, if a router tells it."""
        if client_address.is_loopback:
            return True
        size = LARGE
        for unused in range(8):
            way = self.trace(server, Packet("tcp", client_address, port=CONTROL, size=size, whole=True, answer=True))
            if way.ok:
                client = self.world.machines[way.where]
                return size <= client.interface(way.device).mtu if way.device else True
            end = self.world.machines.get(way.where)
            told = way.outcome == TOO_LARGE and way.where == way.by and end is not None
            if told:
                size = end.interface(way.hops[-1].device).mtu
            elif way.outcome == TOO_LARGE and end is not None and end.addresses & {client_address}:
                size = min(one.mtu for one in end.interfaces)  # it has told its own size when the connection began
            else:
                return False
        return False

    # Datagrams

    def _heard(self, sender, port, size=28):
        """The machines that hear a datagram that a computer sends to the group: {machine: (interface, source, loss)}."""
        member = self.members[sender]
        packet = Packet("udp", self.fleet.multicast_group, port=port, size=size)
        found = {}
        for entry in send_to_group(self.world, sender, member.discovery_address, packet):
            lost = entry.kept
            for link in entry.links:
                lost *= 1 - self.world.links[link].loss
            found.setdefault(entry.machine, (entry.device, entry.source, 1 - lost))
        return found

    def datagram(self, sender, address, port):
        """The way of a datagram to one computer, from the address that its helper is bound to."""
        source = self.members[sender].discovery_address
        return self.trace(sender, Packet("udp", address, source=source, port=port, size=28))

    def multicast(self, computer, listeners):
        """The measurement of multicast_verify on a computer; `listeners` are those of the run."""
        own, port = self.members[computer], self.fleet.multicast_port
        machine = self.world.machines[computer]
        device = machine.find_interface(own.discovery_address)
        refused = 0
        if device is not None:
            probe = Packet("udp", self.fleet.multicast_group, source=own.discovery_address, port=port, size=28)
            refused = PROBES * (machine.find_blocking_rule(OUT, probe, leaving=device.name) is not None)
        return seen.Multicast(
            udp=tuple(
                self._datagrams(own, self.members[other], other in listeners)
                for other in (entry.name for entry in self.fleet.listeners)
                if other != computer
            ),
            unexpected=tuple(
                seen.Stranger(address, device.name, 3)
                for address in self.state.strangers
                if device and own.discovery_address in self.fleet.common_network
            ),
            callers=self._callers(own),
            icmp=self._rounds(own),
            send_errors=seen.SendErrors(refused, "Operation not permitted" if refused else None),
        )

    def _datagrams(self, own, other, runs):
        """The datagrams between two computers; `runs`: the other one's helper does."""
        together = own.multicast and other.multicast
        entry = seen.DatagramCounts(other.name, str(other.discovery_address), together)
        if not runs:
            return entry
        port = self.fleet.multicast_port
        planned = self.world.machines[own.name].find_interface(own.discovery_address)
        came, went = self.heard(other.name, port).get(own.name), self.heard(own.name, port).get(other.name)
        if not together:
            came = went = None
        unicast_here = self.datagram(other.name, own.discovery_address, port)
        unicast_there = self.datagram(own.name, other.discovery_address, port)
        here, there = (
            way.ok and way.where == name for way, name in ((unicast_here, own.name), (unicast_there, other.name))
        )
        asks = self.datagram(own.name, other.discovery_address, CONTROL)
        answers = self.datagram(other.name, own.discovery_address, CONTROL)
        speaks = asks.ok and asks.where == other.name and answers.ok and answers.where == own.name
        known = speaks and bool(came or here or went or there)
        if came:
            device, source, lost = came
            right = planned is not None and device == planned.name
            entry = replace(
                entry,
                heard_from=right,
                heard=PROBES if right else 0,
                source_address=str(source),
                other_interfaces=() if right else (device,),
            )
        if known:
            lost = went[2] if went else 0.0
            missed = sum(self.chance("udp", own.name, other.name, n) < lost for n in range(PROBES))
            entry = replace(
                entry,
                heard_by=bool(went) if together else None,
                loss=(round(missed / PROBES, 3) if went else 1.0) if together else None,
                own_source_address=str(asks.packet.source),
                unicast=there,
            )
        return entry

    def _callers(self, own):
        """The addresses from which the others' empty datagrams come, which they send to computers in other networks."""
        found = {}
        for name, plan in self.fleet.computers.items():
            member = self.members.get(name)
            listens = member is not None and member.discovery
            if name == own.name or name not in self.there:
                continue
            packets = [Packet("udp", own.discovery_address, port=self.fleet.multicast_port, size=28)]
            if listens:
                packets.append(
                    Packet("udp", own.discovery_address, member.discovery_address, self.fleet.multicast_port, size=28)
                )
            for packet in packets:
                way = self.trace(name, packet)
                if way.ok and way.where == own.name:
                    found[str(way.packet.source)] = found.get(str(way.packet.source), 0) + TRIES
        return tuple(seen.LocalCaller(address, count) for address, count in sorted(found.items()))

    def _rounds(self, own):
        """The pings of the group of all hosts on the own network."""
        packet = Packet("icmp", IPv4Address("224.0.0.1"), size=28)
        answered = [[] for _round in range(ROUNDS)]
        hearers = {entry.machine for entry in send_to_group(self.world, own.name, own.discovery_address, packet)}
        for name in hearers & set(self.members):
            plan = self.fleet.computers[name]
            answers = any(one.name.endswith("echo_ignore_broadcasts") and one.value == "0" for one in plan.sysctl)
            back = self.trace(name, Packet("icmp", own.discovery_address, size=28, answer=True))
            for number in range(ROUNDS):
                kept = self.chance("round", own.name, name, number) >= loss(self.world, back)
                if answers and back.ok and kept and self.members[name].discovery:
                    answered[number].append(name)
        rounds = tuple(seen.IcmpRound(number + 1, tuple(sorted(names))) for number, names in enumerate(answered))
        return seen.Icmp("224.0.0.1", rounds=rounds)
