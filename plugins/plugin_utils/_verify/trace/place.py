# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The place where followed packets end: all that the computers captured in, one place for each probe out. Pure.

A packet is walked from its sender, hop by hop: it left by an interface for a hardware address; the computer with this address saw it
come in, and left it go out. An answer is walked in the same way back. The first step that no computer saw is the place.
"""

from __future__ import annotations

import enum
import re
from collections.abc import Callable, Collection, Container, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import NamedTuple

from ..._base.sentences import shorten_list
from ..context.errors import list_own_components
from ..context.packet_filters import GROUP
from ..observe.outcomes import Outcome
from ..observe.packet_trace import CapturedPacket, Counter, SentProbe, TracedProbe, TraceObservation

MOST_HOPS = 16
NAMED = 6  # counters that a sentence names
REQUEST, ANSWER, ERROR, ARP = "request", "answer", "error", "arp"
ONE_HOST = re.compile(r"[0-9a-f][02468ace](:[0-9a-f]{2}){5}")  # a hardware address of no group
# Type and code of ICMP (RFC 792): the datagram has arrived. For a connection, a packet filter says so.
CLOSED_PORT = 3, 3


class Trip(NamedTuple):
    """A kind of packets from a computer to another one."""

    traffic: str  # a word of packet_filters.TRAFFIC
    sender: str
    target: str


class TraceStage(enum.Enum):
    """The last step of packets that was seen; the values are for people: the last step that was seen, and the first that was not."""

    SOURCE = "do not leave {at}"
    ASKED = "do not leave {at}: it asks who has {asked}, and no computer answers"
    WIRE = "left {at}{interface} for {next}{mac}, and did not come in there"
    STRANGER = "left {at}{interface} for{mac}, which no computer of the fleet has{expected}"
    SELF = "left {at}{interface} for its own hardware address{mac}, as if ARP is switched off there"
    HOP = "came in at {at}{interface}, and did not leave it"
    TARGET = "came in at {at}{interface}, which sent no answer"
    WITHHELD = "came in at {at}{interface}, and no program there got them"
    MUTE = "open at {at}, and a question in them gets no answer"
    CUT = "open, and {next} does not confirm a question in them"
    REPORTED = "end at {at}, which reports ICMP type {type}, code {code}"
    CHANGED = "left {at}{interface} {changed}, and {address} was asked"
    CIRCLE = "come back to {at}{interface}, which has passed them on before"
    UNSEEN = "are seen by nobody"  # a computer there did not listen, or has missed packets
    ARRIVED = "arrive, and so does the answer"


@dataclass(frozen=True)
class SeenHop:
    """A step of packets that was seen: out of a computer and, if the next one saw them too, into that."""

    sender: str
    receiver: str  # empty if no computer of the fleet has the hardware address
    network: str  # the planned one between the two; empty if the two have no planned network
    left: str  # the interface of the sender
    target_mac: str
    ttl: int
    answer: bool  # it is a step of the answer
    arrived: bool  # the receiver saw them come in
    came: str = ""  # the interface of the receiver; empty if they were not seen there


@dataclass(frozen=True)
class LossPlace:
    """The place where the packets of a probe end, or those of its answer."""

    probe: TracedProbe
    stage: TraceStage
    at: str = ""  # the computer that saw them last; of a report, the one that reports
    next: str = ""  # the computer that was to see them; empty if no computer is known for it
    answer: bool = False  # the answer ends there
    last: CapturedPacket | None = None  # seen last
    times: int = 0  # that it was seen there
    sent: SentProbe | None = None
    asked: str = ""  # the address that was asked for in vain
    first_ttl: int = 0  # with which the sender has sent them; 0 if it was not seen
    route: tuple[str, ...] = ()  # the planned computers, from the sender of the probe to its target
    hops: tuple[
        SeenHop, ...
    ] = ()  # all that was seen before, those of the answer last; MOST_HOPS at most in each direction

    @property
    def is_fault(self) -> bool:
        """True if packets end there."""
        return self.stage not in (TraceStage.ARRIVED, TraceStage.UNSEEN)

    @property
    def step(self) -> tuple[TraceStage, tuple[str, ...], bool]:
        """The step that no computer saw: other packets may end there, too."""
        return self.stage, self.places, self.answer

    @property
    def places(self) -> tuple[str, ...]:
        """The computers concerned. Packets that end inside a computer end there for all the next ones."""
        return tuple(name for name in (self.at, self.next if self.stage != TraceStage.HOP else "") if name)


@dataclass(frozen=True)
class Map:
    """The owners of addresses and hardware addresses, and the computers that listen."""

    hosts: Mapping[str, frozenset[str]]  # hardware address -> computers: containers of one machine may share one
    name_at: Callable[[str], str]  # IPv4 address -> computer, empty for one of no computer
    listening: frozenset[str]  # and have missed no packet, so packets that they did not see were not there
    networks: Mapping[tuple[str, str], str] = field(default_factory=dict)  # (computer, the next one) -> planned network


class _Walk:
    """The packets of one probe, at all computers."""

    def __init__(
        self, probe: TracedProbe, sent: SentProbe | None, chart: Map, seen: Mapping[str, Sequence[CapturedPacket]]
    ) -> None:
        self.probe, self.sent, self.chart = probe, sent, chart
        connections = {one.sequence for one in seen.get(probe.sender, ()) if self._begins(one)}
        self.own = {host: [one for one in packets if self._is_own(one, connections)] for host, packets in seen.items()}
        self.hops: list[SeenHop] = []  # of all walks, in their order
        self.steps: list[tuple[str, CapturedPacket]] = []  # the packet that left, and from where, of each of these
        self.changers: set[str] = set()  # computers that change ports, as a NAT may do
        self.asks = {host: [one for one in packets if one.protocol == ARP] for host, packets in seen.items()}

    def _begins(self, one: CapturedPacket) -> bool:
        """Return True if a packet at the sender begins the connection of the probe. Programs there may call the same port."""
        asked = (one.outgoing, one.protocol, one.kind) == (True, "tcp", REQUEST)
        called = (one.destination, one.port) == (self.probe.address, self.probe.port)
        return asked and called and self._is_from_port(one)

    def _is_from_port(self, one: CapturedPacket) -> bool:
        return self.sent is not None and one.source_port == self.sent.source_port

    def _is_own(self, one: CapturedPacket, connections: set[int]) -> bool:
        if one.protocol != self.probe.protocol or not (one.outgoing or one.intact):  # the kernel takes no broken one
            return False
        if (
            one.kind == ERROR and one.destination != self.probe.address
        ):  # it quotes an answer, or a person has made it up
            return False
        if one.protocol == "tcp":
            return one.sequence in connections
        if one.kind == ERROR and one.number < 0:  # it quotes too little to have the number
            return self._is_from_port(one)
        return one.number == self.probe.number

    def find_place(self, route: Sequence[str]) -> LossPlace:
        """Find the place. `route` names the planned computers on the way, from the sender to the target."""
        there = self._walk(REQUEST, route)
        first = self._list(self.probe.sender, REQUEST, outgoing=True)
        there = replace(there, first_ttl=first[0].ttl if first else 0)
        reports = self._list_reports()
        report = next((one for one in reports if not self._is_denied(one)), None)
        if report and self._tells_closed_port(report):
            return there
        place = self._find_answer(there, route)
        # A packet with an answer did arrive, even if no computer captured it: a NAT may change the identifiers of pings.
        if self._is_answered() and there.stage != TraceStage.STRANGER:
            return replace(place, stage=TraceStage.ARRIVED)
        if report and not (place.answer and place.stage in (TraceStage.ARRIVED, TraceStage.WITHHELD)):
            at = self.chart.name_at(report.reporter) or report.reporter
            return replace(there, stage=TraceStage.REPORTED, at=at, next="", last=report)
        if reports and not report and (place.stage, self.probe.protocol) == (TraceStage.HOP, "icmp"):
            return replace(place, stage=TraceStage.UNSEEN)  # a NAT there may have given them another identifier
        return self._find_change(place)

    def _list_reports(self) -> list[CapturedPacket]:
        """List the reports of ICMP about the packets, as the sender saw them."""
        return [one for one in self.own.get(self.probe.sender, ()) if one.kind == ERROR]

    def _tells_closed_port(self, report: CapturedPacket) -> bool:
        """Return True if a report is that of datagrams which have arrived, and no program takes them."""
        return self.probe.protocol == "udp" and (report.icmp_type, report.icmp_code) == CLOSED_PORT

    def _is_denied(self, report: CapturedPacket) -> bool:
        """Return True if the computer that is to have reported listened, has sent no such report, and has passed on the packets that came in, if any did."""
        at = self.chart.name_at(report.reporter)
        if at == self.probe.sender or at not in self.chart.listening:
            return False
        is_end = at == self.probe.target
        is_done = is_end and self.probe.protocol == "udp"  # its end sends nothing
        has_passed = is_done or bool(self._list(at, ANSWER if is_end else REQUEST, outgoing=True))
        has_got = bool(self._list(at, REQUEST, outgoing=False))
        return (has_passed or not has_got) and not self._list(at, ERROR, outgoing=True)

    def _is_answered(self) -> bool:
        """Return True if the program that has sent them got an answer, whoever sent it."""
        return self.sent is not None and Outcome.ANSWERED in (self.sent.outcome, self.sent.data)

    def _find_change(self, place: LossPlace) -> LossPlace:
        """Return the place where an address was changed, if packets end by that: at a computer that a foreign rule has made their target, or
        with an answer of another address than was asked; nowhere if no computer saw it change. Other ends are left as they are.
        """
        last = place.last
        changes: list[tuple[str, CapturedPacket]] | None = None
        if last and not last.outgoing and place.stage == TraceStage.HOP and not place.answer:
            changes = self._list_target_changes(last, place.at)
        elif last and not last.outgoing and place.stage == TraceStage.WITHHELD:
            changes = self._list_source_changes(last)
        if changes is None:
            return place
        at, left = changes[0] if changes else ("", None)
        return replace(place, stage=TraceStage.CHANGED if left else TraceStage.UNSEEN, at=at, next="", last=left)

    def _list_target_changes(self, last: CapturedPacket, at: str) -> list[tuple[str, CapturedPacket]] | None:
        """List the packets that left for another address than was asked; None if the last packet did not come in for one of its computer."""
        asked = self.probe.address
        if last.destination == asked or self.chart.name_at(last.destination) != at:
            return None
        return [step for step in self.steps if step[1].destination != asked]

    def _list_source_changes(self, last: CapturedPacket) -> list[tuple[str, CapturedPacket]] | None:
        """List the answers that left from another address than got the question; None if the last one is of the one that was asked."""
        asked = self.probe.address
        if last.source == asked:
            return None
        own = {asked, *(one.destination for one in self._list(self.probe.target, REQUEST, outgoing=False))}
        return [step for step in self.steps if step[1].kind == ANSWER and step[1].source not in own]

    def _find_answer(self, there: LossPlace, route: Sequence[str]) -> LossPlace:
        """Find the place of the answer to a packet that has arrived. A datagram gets no answer."""
        if there.stage != TraceStage.ARRIVED or self.probe.protocol == "udp":
            return there
        if not self._list(self.probe.target, ANSWER, outgoing=True):
            return replace(there, stage=self._unless_blind(self.probe.target, TraceStage.TARGET), at=self.probe.target)
        back = replace(self._walk(ANSWER, route[::-1]), answer=True, first_ttl=there.first_ttl)
        if back.stage == TraceStage.ARRIVED and self.sent and self.sent.outcome == Outcome.NO_ANSWER:
            return replace(back, stage=TraceStage.WITHHELD)
        if back.stage == TraceStage.ARRIVED and self.sent and self.sent.data in (Outcome.NO_ANSWER, Outcome.RESET):
            if self.sent.unconfirmed:
                return replace(back, stage=TraceStage.CUT, at=self.probe.sender, next=self.probe.target, answer=False)
            return replace(back, stage=TraceStage.MUTE, at=self.probe.target)
        return back

    def _unless_blind(self, at: str, stage: TraceStage) -> TraceStage:
        """A computer that did not listen, or has missed packets, shows nothing by packets that it did not see."""
        return stage if at in self.chart.listening else TraceStage.UNSEEN

    def _start(self) -> TraceStage:
        """The stage of packets that their sender was not seen to send. An errno of its kernel is evidence without a listener."""
        if self.sent and list_own_components(self.sent.outcome, self.probe.sender, self.probe.traffic):
            return TraceStage.SOURCE
        if self.sent is None or self.sent.outcome in (Outcome.NOT_TRIED, Outcome.FAILED):  # it may have sent nothing
            return TraceStage.UNSEEN
        return self._unless_blind(self.probe.sender, TraceStage.SOURCE)

    def _list(self, host: str, kind: str, outgoing: bool) -> list[CapturedPacket]:
        """List the packets of a kind at a computer."""
        return [one for one in self.own.get(host, ()) if one.kind == kind and one.outgoing == outgoing]

    def _walk(self, kind: str, route: Sequence[str]) -> LossPlace:
        """Walk from the first computer of the route to the last one."""
        at = route[0]
        came: list[CapturedPacket] = []
        passed = {at}
        following = dict(pairwise(route))
        for _hop in range(MOST_HOPS):
            last = came[-1] if came else None
            place = LossPlace(
                self.probe, TraceStage.HOP, at, following.get(at, ""), last=last, times=len(came), sent=self.sent
            )
            left = self._list_left(at, kind)
            if not left:
                return self._end_inside(place, route)
            place = replace(place, last=left[-1])
            if came and came[-1].source_port != left[-1].source_port:
                self.changers.add(at)
            to = self._find_receiver(left[-1], place.next, [name for name in route if name not in passed], kind)
            came = self._list_came(to, kind)
            self.steps.append((at, left[-1]))
            self.hops.append(self._make_hop(at, to, left[-1], came))
            end_of_step = self._end_step(place, to, came, route, passed)
            if end_of_step:
                return end_of_step
            passed.add(to)
            at = to
        return replace(place, stage=TraceStage.UNSEEN)

    def _end_step(
        self, place: LossPlace, to: str, came: Sequence[CapturedPacket], route: Sequence[str], passed: Container[str]
    ) -> LossPlace | None:
        """Return the place of packets that ended by a step to a computer, or came to their end. None: they go on."""
        if not to:
            return replace(place, stage=TraceStage.STRANGER)
        if to == place.at and not (came and to == route[0]):  # nothing comes in where they begin, unless it came back
            return replace(place, stage=TraceStage.SELF, next="")
        if not came:
            lost = TraceStage.WIRE if to in self.chart.listening else TraceStage.UNSEEN
            return replace(place, stage=lost, next=to)
        if to == route[-1]:
            return replace(place, stage=TraceStage.ARRIVED, at=to, next="", last=came[-1], times=len(came))
        if to not in passed:
            return None
        if to != place.at and not self._came_back(to, route[0], came[0].kind):
            return replace(place, stage=TraceStage.UNSEEN)
        return replace(place, stage=TraceStage.CIRCLE, at=to, next="", last=came[-1], times=len(came))

    def _end_inside(self, place: LossPlace, route: Sequence[str]) -> LossPlace:
        """Return the place of packets that do not leave the computer where they are."""
        asked = self._find_question(place.at, route)
        if asked:
            stage, to = self._unless_blind(place.at, TraceStage.ASKED), self.chart.name_at(asked) or place.next
            return replace(place, stage=stage, asked=asked, next=to)
        # The first one of an answer is there, or it was not walked.
        return replace(place, stage=self._unless_blind(place.at, TraceStage.HOP) if place.last else self._start())

    def _list_came(self, host: str, kind: str) -> list[CapturedPacket]:
        """List the packets that came in at a computer, once each: an interface above another one shows each of them last."""
        came = self._list(host, kind, outgoing=False)
        return [one for one in came if one.interface == came[-1].interface]

    def _list_left(self, host: str, kind: str) -> list[CapturedPacket]:
        """List the packets that left a computer, once each: an interface above another one shows each of them first."""
        left = self._list(host, kind, outgoing=True)
        return [one for one in left if one.interface == left[0].interface]

    def _came_back(self, to: str, first: str, kind: str) -> bool:
        """Return True if packets came in once more at a place that they have passed: at the first computer, or with less of their life."""
        return to == first or len({one.ttl for one in self._list(to, kind, outgoing=False)}) > 1

    def _make_hop(self, at: str, to: str, left: CapturedPacket, came: Sequence[CapturedPacket]) -> SeenHop:
        return SeenHop(
            sender=at,
            receiver=to,
            network=self.chart.networks.get((at, to), ""),
            left=left.interface,
            target_mac=left.target_mac,
            ttl=left.ttl,
            answer=left.kind == ANSWER,
            arrived=bool(came),
            came=came[-1].interface if came else "",
        )

    def _find_receiver(self, left: CapturedPacket, planned: str, rest: Iterable[str], kind: str) -> str:
        """Name the computer for which a packet left; a group and an interface without hardware addresses name no computer.

        A hardware address that no answer showed may be that of the planned one all the same: a bridge translates it, and the packet came
        in for an own one, or the computer was not asked. It may be that of a router of no fleet, too: then it came in at one of the rest.
        """
        holders = self.chart.hosts.get(left.target_mac, frozenset())
        if planned in holders or not ONE_HOST.fullmatch(left.target_mac):
            return planned
        members = dict.fromkeys((planned, *rest))
        came = [name for name in dict.fromkeys((*sorted(holders), *members)) if self._has_own(name, kind)]
        on_way = members.keys() & set(came)
        # Any program may claim an address of a stranger, and that packets came in: the ones that got them later say that it is not so.
        got = [name for name in came if name in on_way or not on_way or self._passes_on(name, kind, on_way)]
        if got or holders:
            return next(iter([*got, *sorted(holders)]))
        return "" if planned in self.chart.listening else planned

    def _has_own(self, name: str, kind: str) -> bool:
        """Return True if packets came in at a computer for one of its own hardware addresses."""
        return any(name in self.chart.hosts.get(one.target_mac, ()) for one in self._list(name, kind, outgoing=False))

    def _passes_on(self, name: str, kind: str, others: Collection[str]) -> bool:
        """Return True if packets left a computer for a foreign one."""
        holders = [self.chart.hosts.get(one.target_mac, frozenset()) for one in self._list_left(name, kind)[-1:]]
        return any(name not in names and names & set(others) for names in holders)

    def _find_question(self, host: str, route: Sequence[str]) -> str:
        """Return the address for which a computer asked in vain, of those on the way: programs ask for others, too."""
        asks = self.asks.get(host, ())
        # The kernel takes an answer only if it comes in at the interface that has asked: the uppermost of those that show it.
        answered = {(one.source, one.interface) for one in asks if not one.outgoing}
        asked: dict[str, str] = {}
        for one in asks:
            if one.outgoing and one.kind == REQUEST:
                asked.setdefault(one.destination, one.interface)
        due = (one for one in asked.items() if self.chart.name_at(one[0]) in route or one[0] == self.probe.address)
        return next((address for address, interface in due if (address, interface) not in answered), "")


def locate(looks: Mapping[str, TraceObservation], chart: Map, routes: Mapping[int, Sequence[str]]) -> list[LossPlace]:
    """Find the place of each probe. `routes` has the planned computers on the way of each."""
    seen = {host: look.packets.seen for host, look in looks.items() if look.packets}
    found: list[LossPlace] = []
    changers: set[str] = set()
    for look in looks.values():
        sent = {one.number: one for one in look.sent}
        for probe in (probe for probe in look.probes if probe.number in routes):
            walk, route = _Walk(probe, sent.get(probe.number), chart, seen), routes[probe.number]
            found.append(replace(walk.find_place(route), route=tuple(route), hops=tuple(walk.hops)))
            changers |= walk.changers
    return [replace(one, stage=TraceStage.UNSEEN) if _is_hidden(one, changers) else one for one in found]


def _is_hidden(place: LossPlace, changers: Container[str]) -> bool:
    """Return True if pings may have left a computer unseen: one that changes the ports of its neighbours may change the identifiers of pings."""
    return (place.stage, place.probe.protocol) == (TraceStage.HOP, "icmp") and place.at in changers


# Words

PROBES = {"icmp": "pings", "tcp": "connections to port {port}", "udp": "datagrams to port {port}"}


def describe_probe(probe: TracedProbe) -> str:
    """Name the packets, for a sentence."""
    if probe.traffic == GROUP:
        return f"datagrams of {probe.sender} to the group"
    size = f" of {probe.size} bytes" if probe.size else ""
    return f"{PROBES[probe.protocol].format(port=probe.port)}{size} from {probe.sender} to {probe.target}"


def describe_place(place: LossPlace, chart: Map) -> str:
    """Return the last step that was seen, and the first that was not, of a place that is a fault."""
    last, answers = place.last, "the answers to " if place.answer and place.stage != TraceStage.MUTE else ""
    own = sorted(mac for mac, names in chart.hosts.items() if place.next in names)
    words = {
        "at": place.at,
        "next": place.next,
        "address": place.probe.address,
        "changed": (f"from {last.source}" if place.answer else f"for {last.destination}") if last else "",
        "asked": place.asked,
        "interface": f" on {last.interface}" if last else "",
        "mac": f" {last.target_mac}" if last and last.target_mac else "",
        "type": last.icmp_type if last else "",
        "code": last.icmp_code if last else "",
        "expected": f" ({place.next}, which was expected, has {' and '.join(own[:2])})" if own else "",
    }
    return f"{answers}{describe_probe(place.probe)} {place.stage.value.format(**words)}"


def describe_counters(counters: Iterable[Counter]) -> str:
    """Name the counters of a computer that have grown meanwhile; empty if no counter has grown."""
    found = shorten_list([f"{one.counter} +{one.more}" for one in counters], NAMED)
    return f"meanwhile its kernel counted {found}" if found else ""
