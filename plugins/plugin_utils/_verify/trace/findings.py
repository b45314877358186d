# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The packet trace of a run: the places where packets end, and the component that each leaves. Pure."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

from ..._base import advice
from ..._faults.fault import Advice, Advices
from ..checks.engine import Verification
from ..components.component import Component
from ..observe.packet_trace import SeenPackets, TraceObservation
from .place import LossPlace, Map, SeenHop, Trip, describe_counters, describe_place, locate
from .suspects import find_sign, is_consistent, name_place


@dataclass(frozen=True)
class DrawnWay:
    """The way of followed packets to their end, as it is drawn."""

    computers: tuple[str, ...]  # the planned ones, from the sender of the probe to its target
    hops: tuple[SeenHop, ...]
    at: str  # the computer that saw them last, or reports that they end
    words: str  # the observation at the end


@dataclass(frozen=True)
class SeenEnd:
    """A place where packets end, by the packet trace."""

    place: LossPlace
    words: str  # the observation there
    sign: Component | None  # the one component of the table that this shows

    @property
    def component(self) -> Component:
        """The component that the place shows, or the place itself."""
        return self.sign or name_place(self.place, self.words)

    @property
    def way(self) -> DrawnWay:
        """The way of its packets."""
        return DrawnWay(self.place.route, self.place.hops, self.place.at, self.words)

    @property
    def trip(self) -> Trip:
        """The trip of its packets."""
        probe = self.place.probe
        return Trip(probe.traffic, probe.sender, probe.target)

    @property
    def look(self) -> Advices:
        """Advise to look at the route of its packets at the place, and at the rules that they meet there."""
        last = self.place.last
        address = last.destination if last and self.place.answer else self.place.probe.address
        command = advice.command("ip route get {}; nft -a list ruleset", ("address", address))
        effect = "the route of these packets, and the rules that they meet"
        return (Advice(self.place.at, command, effect),) if command and self.place.at else ()

    def crosses(self, computers: Iterable[str]) -> bool:
        """Return True if a way by these computers leads through the place, and by the component that it shows."""
        return {*self.place.places, *(self.sign.places if self.sign else ())} <= set(computers)

    def choose(self, suspects: Iterable[Component]) -> frozenset[Component]:
        """Return the suspects that the place leaves; the place itself if it leaves no suspect."""
        left = () if self.sign else (component for component in suspects if is_consistent(component, self.place))
        return frozenset(left) or frozenset({self.component})


def find_ends(verification: Verification) -> list[SeenEnd]:
    """Find the places where the followed packets of a run end; nothing if the run followed no packets."""
    looks = {name: one.seen.packet_trace for name, one in verification.run.items() if one.seen.packet_trace}
    probes = [probe for look in looks.values() for probe in look.probes]
    links = {probe.number: verification.ways.list_links(probe.sender, probe.target) for probe in probes}
    name_at = name_addresses(verification)
    chart = Map(
        hosts=_list_holders((mac, name) for name, one in verification.run.items() for mac in one.hardware_addresses),
        name_at=name_at,
        listening=frozenset(name for name, look in looks.items() if look.packets and has_all(look.packets, name_at)),
        networks=_name_networks(links.values()),
    )
    routes = {number: list(dict.fromkeys(place for place, _network in own)) for number, own in links.items()}
    return [_describe(place, chart, looks) for place in locate(looks, chart, routes) if place.is_fault]


def _list_holders(pairs: Iterable[tuple[str, str]]) -> dict[str, frozenset[str]]:
    """List for each address the computers that have it."""
    found = defaultdict(set)
    for address, name in pairs:
        found[address].add(name)
    return {address: frozenset(names) for address, names in found.items()}


def name_addresses(verification: Verification) -> Callable[[str], str]:
    """Name the computer with an address: the planned one, or the only one that was read to have it, in addition to its planned ones."""
    read = _list_holders(
        (address, name)
        for name, one in verification.run.items()
        for interface in one.interfaces
        for address in interface.addresses
    )
    more = {address: min(names) for address, names in read.items() if len(names) == 1}
    return lambda address: verification.ways.name_at(address) or more.get(address, "")


def has_all(packets: SeenPackets, name_at: Callable[[str], str]) -> bool:
    """Return True if a listener has kept all packets of the fleet: strangers may have sent more than it keeps of one."""
    return not packets.missed and not any(map(name_at, packets.full))


def _name_networks(links: Iterable[Sequence[tuple[str, str]]]) -> dict[tuple[str, str], str]:
    """Name the network between each two neighbours, in both directions."""
    steps = {step for own in links for step in pairwise(own) if step[0][1] == step[1][1]}
    return {pair: network for (one, network), (two, _same) in steps for pair in ((one, two), (two, one))}


def _describe(place: LossPlace, chart: Map, looks: Mapping[str, TraceObservation]) -> SeenEnd:
    packets = (looks[place.at].packets if place.at in looks else None) or SeenPackets()
    words = [describe_place(place, chart), describe_counters(packets.counters)]
    return SeenEnd(place, "; ".join(filter(None, words)), find_sign(place, packets))
