# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Five computers, packets that end somewhere between them, and one computer that lies about what it saw, is and has. Seeded."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from itertools import pairwise

from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observe.outcomes import Outcome
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observe.packet_trace import (
    CapturedPacket,
    SeenPackets,
    SentProbe,
    TracedProbe,
    TraceObservation,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.trace import findings, place

NAMES = ("ann", "bob", "cat", "dan", "eve")
NUMBERS = {name: number for number, name in enumerate(NAMES, 1)}
TRAFFIC = {"icmp": "icmp", "tcp": "rpc", "udp": "udp"}
ROUTER, NOBODY = 10, 11  # numbers of strangers: a router that passes packets on, and a computer that does not
ENDS = ("nowhere", "wire", "hop", "stranger", "question", "report")


def mac(number):
    return f"02:00:00:00:00:{number:02x}"


def address(number):
    return f"10.0.0.{number}"


MACS, ADDRESSES = [mac(number) for number in range(1, 13)], [address(number) for number in range(1, 13)]
STRANGE = {
    "outgoing": [True, False],
    "kind": ["request", "answer", "error", "arp"],
    "protocol": ["icmp", "tcp", "udp", "arp"],
    "source": ADDRESSES,
    "destination": ADDRESSES,
    "source_port": [0, 1, 4000],
    "port": [0, 11611],
    "number": [-1, 3, 4],
    "sequence": [0, 77, 78],
    "ttl": [0, 1, 64],
    "target_mac": [*MACS, "", "ff:ff:ff:ff:ff:ff"],
    "reporter": ADDRESSES,
    "icmp_type": [-1, 3, 11],
    "icmp_code": [-1, 3, 13],
}


@dataclass
class World:
    """The truth, or what computers tell of it."""

    route: list[str]
    probe: TracedProbe
    sent: SentProbe
    seen: dict[str, list[CapturedPacket]] = field(default_factory=lambda: {name: [] for name in NAMES})
    macs: dict[str, set[str]] = field(default_factory=lambda: {name: {mac(NUMBERS[name])} for name in NAMES})
    addresses: dict[str, set[str]] = field(default_factory=lambda: {name: {address(NUMBERS[name])} for name in NAMES})

    def find(self):
        """The place that the controller finds."""
        planned = {address(number): name for name, number in NUMBERS.items()}
        read = findings._list_holders((one, name) for name, own in self.addresses.items() for one in own)
        more = {one: min(names) for one, names in read.items() if len(names) == 1}
        chart = place.Map(
            findings._list_holders((one, name) for name, own in self.macs.items() for one in own),
            lambda one: planned.get(one) or more.get(one, ""),
            frozenset(NAMES),
        )
        looks = {name: TraceObservation(packets=SeenPackets(tuple(packets))) for name, packets in self.seen.items()}
        looks[self.route[0]] = replace(looks[self.route[0]], probes=(self.probe,), sent=(self.sent,))
        (found,) = place.locate(looks, chart, {self.probe.number: self.route})
        return found

    def see(self, name, outgoing, kind, target_mac, **more):
        """Let a computer see a packet."""
        ends = [address(NUMBERS[one]) for one in (self.route[0], self.route[-1])]
        ends = ends[::-1] if kind == "answer" else ends
        tcp, ports = self.probe.protocol == "tcp", 4000 if self.probe.port else 0
        values = {"number": -1 if tcp else 3, "sequence": 77 if tcp else 0, "ttl": 64, "target_mac": target_mac, **more}
        self.seen[name].append(
            CapturedPacket("eth0", outgoing, kind, self.probe.protocol, *ends, ports, self.probe.port, **values)
        )

    def send(self, way, kind, end, at, router):
        """Send packets by a way. They end behind the computer with the number `at`; says if they arrive."""
        for number, (one, other) in enumerate(pairwise(way)):
            is_end = number == at
            if is_end and end == "question":
                ends = address(NUMBERS[one]), address(NUMBERS[other])
                self.seen[one].append(CapturedPacket("eth0", True, "request", "arp", *ends))
            if is_end and end == "report" and number and kind == "request":
                self.report(way[number::-1])
            if is_end and end in ("hop", "question", "report"):
                return False
            strange = NOBODY if is_end and end == "stranger" else ROUTER if number == router else 0
            self.see(one, True, kind, mac(strange or NUMBERS[other]))
            if is_end and end in ("wire", "stranger"):
                return False
            self.see(other, False, kind, mac(NUMBERS[other]))
        return True

    def report(self, way):
        """Let the first of a way report to the last one that the packets end."""
        for one, other in pairwise(way):
            for name, outgoing in ((one, True), (other, False)):
                more = {"icmp_type": 3, "icmp_code": 13, "reporter": address(NUMBERS[way[0]])}
                self.see(name, outgoing, "error", mac(NUMBERS[other]), **more)


def draw_world(chance):
    """Draw what is true."""
    route = chance.sample(NAMES, chance.choice([2, 3, 4]))
    protocol = chance.choice(list(TRAFFIC))
    port = 0 if protocol == "icmp" else 11611
    probe = TracedProbe(3, route[0], route[-1], TRAFFIC[protocol], protocol, address(NUMBERS[route[-1]]), port)
    world = World(route, probe, SentProbe(3, Outcome.NO_ANSWER, source_port=4000))
    end, at = chance.choice(ENDS), chance.randrange(len(route) - 1)
    router = chance.choice([None, *range(len(route) - 1)])
    is_back = protocol != "udp" and chance.random() < 0.4
    arrives = world.send(route, "request", "nowhere" if is_back else end, at, router)
    if arrives and protocol != "udp":
        back = None if router is None else len(route) - 2 - router
        if world.send(route[::-1], "answer", end if is_back else "nowhere", at, back):
            world.sent = replace(world.sent, outcome=Outcome.ANSWERED if protocol == "icmp" else Outcome.OPEN)
    return world


def draw_lie(chance, world, liar):
    """Draw what is told where one computer lies."""
    kind = chance.choice(["less", "other", "more", "macs", "addresses", "all"])
    packets, sent, macs, addresses = list(world.seen[liar]), world.sent, dict(world.macs), dict(world.addresses)
    if kind in ("less", "all"):
        packets = [one for one in packets if chance.random() < 0.5]
    if kind in ("other", "all"):
        packets = [_change(chance, one) for one in packets]
    known = [one for own in world.seen.values() for one in own]
    if kind in ("more", "macs", "all") and known:
        packets += [_change(chance, chance.choice(known)) for _number in range(chance.randrange(8))]
    if kind in ("macs", "all"):
        macs[liar] = {one for one in MACS if chance.random() < 0.5}
    if kind in ("addresses", "all"):
        addresses[liar] = {one for one in ADDRESSES if chance.random() < 0.5}
    if liar == world.route[0] and chance.random() < 0.5:
        outcomes = {key: chance.choice(list(Outcome)) for key in ("outcome", "data")}
        sent = replace(sent, **outcomes, source_port=chance.choice([0, 4000]), unconfirmed=chance.choice([0, 2]))
    chance.shuffle(packets)
    return World(world.route, world.probe, sent, {**world.seen, liar: packets}, macs, addresses)


def _change(chance, one):
    return replace(one, **{key: chance.choice(values) for key, values in STRANGE.items() if chance.random() < 0.3})
