# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""A prediction: the ways between computers after site.yml, why some fail, and the differences from now.

Pure: the plan and the facts in; plain data, sentences and a table out.
"""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Container, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from ipaddress import IPv4Address
from itertools import chain, permutations
from typing import NamedTuple

from .._base.features import load_hooks
from .._base.sentences import shorten_list
from .._faults.fault import CONTROLLER, INVENTORY, Advices, Fault, write_advices
from .._faults.foreseen import PREDICTED, PREDICTIONS
from .._network import facts, packets
from .._network.model import Packet, Rule, World
from .._network.packets import Trace
from .._plan.model import FleetPlan, Member
from .remedies import TRANSLATED, Scene

CONNECTIONS, LARGE = "connections of nodes", "large packets"
REACHES, FAILS, UNSURE = "reaches", "fails", "unsure"
FULL = 1500  # bytes of a large packet
NODES = 45000  # an example of the ports of nodes, which the kernel chooses above 32768
WIDTH = 120
MATRIX = 16  # computers: a larger matrix is not printed
ALL = 30  # computers of which all pairs are tried
PAIRS, MOST = 4, 8  # pairs and machines that are named in a sentence


def _ping(fleet: FleetPlan, one: Member, other: Member) -> Packet | None:
    return Packet("icmp", other.address)


def _call_node(fleet: FleetPlan, one: Member, other: Member) -> Packet | None:
    return Packet("tcp", other.address, port=NODES)


def _fill_packet(fleet: FleetPlan, one: Member, other: Member) -> Packet | None:
    """Make a full packet, which must not be cut."""
    return Packet("tcp", other.address, port=NODES, size=FULL, whole=True)


def _beat(fleet: FleetPlan, one: Member, other: Member) -> Packet | None:
    if not (one.discovery and other.discovery):
        return None
    return Packet("udp", other.discovery_address, port=fleet.multicast_port)


def _call_relay(fleet: FleetPlan, one: Member, other: Member) -> Packet | None:
    """Make a packet to the relay that a relay asks, if a topic or service crosses by both."""
    own, its = (fleet.computers[member.name].relay for member in (one, other))
    if own is None or its is None or other.robot not in {channel["peer"] for channel in own["channels"]}:
        return None
    return Packet("tcp", other.discovery_address, port=its["port"])


class Traffic(NamedTuple):
    """A kind of packets that the fleet needs."""

    name: str
    make_packet: Callable[[FleetPlan, Member, Member], Packet | None]  # None between computers that do not need it
    discovery: bool = False  # for discovery nodes, which ignore it if its source address was translated


TRAFFIC = (
    Traffic("ping", _ping),
    Traffic("heartbeats", _beat, discovery=True),
    Traffic(CONNECTIONS, _call_node),
    Traffic(LARGE, _fill_packet),
)


def list_declared() -> tuple[Traffic, ...]:
    """List the traffic of few ways: that of the relays, and that of the optional features."""
    return (Traffic("topics by the relay", _call_relay), *load_hooks("predict", Traffic).values())


class End(NamedTuple):
    """The place where packets end, and the reason: one sentence is about it."""

    outcome: str
    where: str
    network: str  # to which they were going
    hop: str = ""  # the next machine, as an address
    traffic: str = ""  # empty, unless only this traffic ends
    remedy: Advices = ()  # from the values that were read

    @property
    def fault(self) -> Fault:
        """The row of the table of faults."""
        return PREDICTIONS[PREDICTED, self.outcome]


class Pair(NamedTuple):
    """The states of one kind of traffic from one computer to an other, with the answers."""

    traffic: str
    observer: str
    target: str
    now: str
    after: str
    end: End | None = None  # after site.yml: if it fails, or is translated


@dataclass(frozen=True)
class Prediction:
    """All pairs, and the computers without facts."""

    pairs: Sequence[Pair]
    computers: Sequence[str]
    assumed: Sequence[str]  # computers and devices without facts
    unclear: Sequence[str]  # machines with rules that are not understood
    refused: Sequence[str] = ()  # computers that stay as they are, so no way to or from them is predicted

    @property
    def failures(self) -> Mapping[End, Sequence[Pair]]:
        """The pairs that would fail or be translated, by end, the most frequent first."""
        bad = [pair for pair in self.pairs if pair.after != UNSURE and pair.end is not None]
        small = {(pair.observer, pair.target) for pair in bad if pair.traffic == CONNECTIONS}
        groups: dict[tuple[str, str], list[Pair]] = {}
        for pair in bad:
            if pair.end and not (pair.traffic == LARGE and (pair.observer, pair.target) in small):
                groups.setdefault((pair.end.outcome, pair.end.where), []).append(pair)
        return {_join_ends(pairs): pairs for pairs in sorted(groups.values(), key=len, reverse=True)}

    def count(self, now: str = "", after: str = "", traffic: str = "") -> int:
        """Count the pairs with these states; an empty text is any."""
        return sum(
            now in ("", pair.now) and after in ("", pair.after) and traffic in ("", pair.traffic) for pair in self.pairs
        )


def _join_ends(pairs: Sequence[Pair]) -> End:
    """Return one end for ends at one place with one outcome."""
    ends = [pair.end for pair in pairs if pair.end is not None]
    words = zip(*((end.network, end.hop, end.traffic) for end in ends), strict=True)
    network, hop, traffic = (" and ".join(dict.fromkeys(filter(None, values))) for values in words)
    remedy = tuple(dict.fromkeys(one for end in ends for one in end.remedy))
    return End(ends[0].outcome, ends[0].where, network, hop, traffic, remedy)


def predict(fleet: FleetPlan, infos: Mapping[str, facts.Info], refused: Container[str] = ()) -> Prediction:
    """Predict the ways between all computers, from their facts. The `refused` ones stay as they are: others may pass by them."""
    known = facts.read_machines(fleet, infos)
    now = facts.join_world(fleet, known)
    after = facts.apply_plan(fleet, now, (name for name in known if name not in refused))
    members = [member for member in fleet.members if member.name not in refused]
    return Prediction(
        pairs=list(_pairs(Scene(fleet, after, known), members, now)),
        computers=[member.name for member in members],
        refused=[member.name for member in fleet.members if member.name in refused],
        assumed=[name for name in after.machines if name not in known],
        unclear=[machine.name for machine in after.machines.values() if machine.unclear],
    )


def _pairs(scene: Scene, members: Sequence[Member], now: World) -> Iterator[Pair]:
    fleet, after = scene.fleet, scene.world
    same = now == after  # as after every site.yml
    few = list_declared()
    declared = ((one, other, few) for one, other in permutations(members, 2))
    for one, other, traffics in chain(choose_ways(members), declared):
        for traffic in traffics:
            packet = traffic.make_packet(fleet, one, other)
            if packet is not None:
                later, end = _outcome(scene, one.name, other.name, packet, traffic)
                before = (
                    later if same else _outcome(scene._replace(world=now), one.name, other.name, packet, traffic)[0]
                )
                yield Pair(traffic.name, one.name, other.name, before, later, end)


def choose_ways(members: Sequence[Member]) -> Iterator[tuple[Member, Member, Sequence[Traffic]]]:
    """Yield the pairs that are tried, and their kinds of traffic: all of a small fleet.

    In a large fleet: each computer to and from its own robot and the next robot, and a ping between each two robots.
    """
    if len(members) <= ALL:
        yield from ((one, other, TRAFFIC) for one in members for other in members if one != other)
        return
    last = {member.robot: member for member in members}  # of its robot: behind the gateway, if there is one
    robots = list(last)
    following = dict(zip(robots, robots[1:] + robots[:1], strict=True))
    whole: dict[tuple[str, str], tuple[Member, Member]] = {}
    for member in members:
        for other in (last[member.robot], last[following[member.robot]]):
            whole.update({(one.name, two.name): (one, two) for one, two in ((member, other), (other, member))})
    yield from ((one, other, TRAFFIC) for one, other in whole.values() if one != other)
    for first in last.values():
        yield from ((first, two, TRAFFIC[:1]) for two in last.values() if (first.name, two.name) not in whole)


def _outcome(scene: Scene, start: str, target: str, packet: Packet, traffic: Traffic) -> tuple[str, End | None]:
    world = scene.world
    way = packets.echo(world, start, packet)
    failure = way.failure
    if failure is None and way.there.where == target:
        if way.there.translations:
            where = way.there.translations[0][0]
            remedy = scene.advise(way.there, TRANSLATED, where)
            end = End(TRANSLATED, where, _network(scene.fleet, packet.destination), remedy=remedy)
            return (FAILS if traffic.discovery else REACHES), end
        return REACHES, None
    if failure is None:
        failure = replace(way.there, outcome=packets.ELSEWHERE)
    if failure.outcome == packets.TOO_LARGE and (_is_reported(world, failure) or failure.where in (start, target)):
        return REACHES, None  # TCP learns the size that fits: on the way by ICMP, and from the other end when it begins
    end = _end(scene, failure, traffic)
    unsure = failure.outcome in (packets.FILTERED, packets.REJECTED) and world.machines[failure.where].unclear
    return (UNSURE if unsure else FAILS), end


def _is_reported(world: World, way: Trace) -> bool:
    """Return True if a machine on the way reports to the sender that a packet is too large."""
    return way.where == way.by and way.where in world.machines


def _end(scene: Scene, way: Trace, traffic: Traffic) -> End:
    outcome, hop = way.outcome, None
    if outcome == packets.REJECTED and not isinstance(way.rule, Rule):
        outcome = packets.CLOSED  # by a route or a rule for routing
    elif outcome == packets.REVERSE_PATH and scene.find_closed_route(way):
        outcome = packets.CLOSED
    elif outcome == packets.NO_ROUTE and scene.find_interface_down(way):
        outcome = packets.DOWN  # its routes went with it
    elif outcome == packets.NOBODY and way.hops:
        hop = way.hops[-1].to
    elif outcome == packets.ELSEWHERE:
        hop = way.packet.destination
    precise = outcome in (packets.FILTERED, packets.REJECTED, packets.TOO_LARGE)
    network = _network(scene.fleet, way.packet.destination)
    remedy = scene.advise(way, outcome, way.where)
    return End(outcome, way.where, network, str(hop or ""), traffic.name if precise else "", remedy)


def _network(fleet: FleetPlan, address: IPv4Address) -> str:
    links = fleet.network_names
    return next((link for network, link in links.items() if address in network), str(address))


# Sentences


def write_sentence(end: End, pairs: Sequence[Pair], inventory: str = "") -> str:
    """Return one sentence: the place where packets would end, the ways that fail, and the remedy."""
    what, remedy = _describe(end, "it"), write_advices((*list_do(end, inventory), *list_look(end)))
    effect = "would not work; expected a way there and back"
    if all(pair.after == REACHES for pair in pairs):
        effect = "would show another address, by which no node is found; expected the computer's own"
    return f"{end.where}: after site.yml {what}, so {_name_ways(pairs)} {effect} [{end.fault.id}]: {remedy}."


def _describe(end: End, place: str = "") -> str:
    """Return the sentence on a place."""
    words = {"hop": end.hop, "traffic": end.traffic}
    return end.fault.sentence.format(place=place or end.where, what=end.network, **words)


def list_do(end: End, inventory: str = "") -> Advices:
    """Return the remedy at a place: that of the values that were read, and of the row what lasts."""
    own = end.fault.fill(end.fault.do, (end.where,), "", inventory)
    if not end.remedy:
        return own
    changes = {one.where for one in end.remedy if one.where == INVENTORY}
    return (*end.remedy, *(one for one in own if one.where in {CONTROLLER, INVENTORY} - changes))


def list_look(end: End) -> Advices:
    """Return the commands to look with at a place."""
    return end.fault.fill(end.fault.look, (end.where,), "")


def _name_ways(pairs: Sequence[Pair]) -> str:
    return shorten_list(dict.fromkeys(f"{pair.observer} -> {pair.target}" for pair in pairs), PAIRS)


def warnings(prediction: Prediction, inventory: str = "") -> list[str]:
    """Return a sentence for each place at which packets would end after site.yml. `inventory` is that of the run, as a command has it."""
    return [write_sentence(end, pairs, inventory) for end, pairs in prediction.failures.items()]


def name_refused(prediction: Prediction) -> list[str]:
    """Return a sentence about the computers that are left out, if there are some."""
    if not prediction.refused:
        return []
    who = shorten_list(prediction.refused, MOST)
    return [f"Left out of the prediction, since they stay as they are in this run: {who}."]


def list_ways(prediction: Prediction) -> list[dict[str, str]]:
    """Return the ways that do not work now or after site.yml, as plain data."""
    return [
        {
            "from": pair.observer,
            "to": pair.target,
            "traffic": pair.traffic,
            "now": pair.now,
            "after": pair.after,
            "where": pair.end.where if pair.end else "",
            "why": _describe(pair.end) if pair.end else "",
            "id": pair.end.fault.id if pair.end else "",
        }
        for pair in prediction.pairs
        if pair.after != REACHES or pair.now != REACHES
    ]


# The table


def render(prediction: Prediction, inventory: str = "") -> str:
    """Return the prediction for the terminal. `inventory` is that of the run, as a command has it."""
    parts = [f"PREDICTION for {len(prediction.computers)} computers, after site.yml", _table(prediction)]
    if 1 < len(prediction.computers) <= MATRIX:
        parts.append(_matrix(prediction))
    if prediction.failures:
        parts.append("\n".join(["Would not be as planned:", *_groups(prediction, inventory)]))
    parts += _notes(prediction)
    parts.append(write_verdict(prediction))
    return "\n\n".join(parts)


def _table(prediction: Prediction) -> str:
    count = prediction.count
    shown = [*TRAFFIC, *(traffic for traffic in list_declared() if count(traffic=traffic.name))]
    width = max(len(traffic.name) for traffic in shown)
    columns = ("pairs", "now", "after", "begin", "end", "unsure")
    lines = [f"  {'would reach each other':<{max(width, 22)}}" + "".join(f"{column:>9}" for column in columns)]
    for name in (traffic.name for traffic in shown):
        numbers = (
            count(traffic=name),
            count(now=REACHES, traffic=name),
            count(after=REACHES, traffic=name),
            count(now=FAILS, after=REACHES, traffic=name),
            count(now=REACHES, after=FAILS, traffic=name),
            count(after=UNSURE, traffic=name),
        )
        lines.append(f"  {name:<{max(width, 22)}}" + "".join(f"{number or '-':>9}" for number in numbers))
    return "\n".join(lines)


def _matrix(prediction: Prediction) -> str:
    """Return the matrix of the ways after site.yml, from rows to columns. A `+` marks a new one."""
    states: dict[tuple[str, str], list[Pair]] = {}
    for pair in prediction.pairs:
        states.setdefault((pair.observer, pair.target), []).append(pair)
    width = max(len(name) for name in prediction.computers)
    lines = [f"  {'from / to':<{width + 4}}" + "".join(f"{n:>6}" for n in range(1, len(prediction.computers) + 1))]
    for number, observer in enumerate(prediction.computers, 1):
        cells = "".join(f"{_cell(states.get((observer, target), ())):>6}" for target in prediction.computers)
        lines.append(f"  {number:>2}  {observer:<{width}}{cells}")
    return "\n".join(lines)


def _cell(pairs: Sequence[Pair]) -> str:
    if not pairs:
        return "-"
    after = {pair.after for pair in pairs}
    if after == {REACHES}:
        return "ok" if all(pair.now == REACHES for pair in pairs) else "ok +"
    if FAILS not in after:
        return "?"
    return "FAIL" if all(pair.after == FAILS for pair in pairs) else "part"


def _groups(prediction: Prediction, inventory: str) -> Iterator[str]:
    for number, (end, pairs) in enumerate(prediction.failures.items(), 1):
        do, look = write_advices(list_do(end, inventory)), write_advices(list_look(end))
        what = f"{_describe(end)} [{end.fault.id}]"
        rows = (
            (f"{number:>3}. ", what),
            ("     for:    ", _name_ways(pairs)),
            ("     do:     ", do),
            ("     look:   ", look),
        )
        for label, text in rows:
            lines = textwrap.wrap(text, WIDTH - len(label), break_long_words=False, break_on_hyphens=False)
            yield label + f"\n{' ' * len(label)}".join(lines)


def _notes(prediction: Prediction) -> list[str]:
    notes = name_refused(prediction)
    if prediction.assumed:
        notes.append(f"Not looked at, and taken as planned: {shorten_list(prediction.assumed, MOST)}.")
    if prediction.unclear:
        notes.append(
            f"The packet filter says more than is understood here, see nft list ruleset on: {shorten_list(prediction.unclear, MOST)}."
        )
    return ["\n".join(notes)] if notes else []


def write_verdict(prediction: Prediction) -> str:
    """Return the result in one sentence."""
    reach, total = prediction.count(after=REACHES), len(prediction.pairs)
    if not total:
        return f"PREDICTED: nothing, since there is no way to judge between {len(prediction.computers)} computers."
    changes = {
        "more than now": prediction.count(now=FAILS, after=REACHES),
        "that work now would not": prediction.count(now=REACHES, after=FAILS),
        "that cannot be said": prediction.count(after=UNSURE),
    }
    change = "".join(f", {number} {words}" for words, number in changes.items() if number)
    verdict = "PREDICTED: all" if reach == total else f"PREDICTED: {reach}"
    return f"{verdict} of {total} ways would work after site.yml{change}."
