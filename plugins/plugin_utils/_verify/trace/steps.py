# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""A packet trace as data: the computers on the way, and the steps of the packets at each of them. Pure."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import groupby

from .findings import SeenEnd
from .place import SeenHop, describe_probe

LEFT, CAME, ENDS = "left", "came in", "ends"  # actions


@dataclass(frozen=True)
class TraceStep:
    """A step of packets at a computer, and its evidence."""

    action: str
    detail: str


@dataclass(frozen=True)
class TraceHop:
    """A computer on the way, with its steps in their order."""

    computer: str
    steps: tuple[TraceStep, ...]


@dataclass(frozen=True)
class PacketTrace:
    """The way of followed packets to their end."""

    packets: str  # the kind of the packets
    disposition: str  # how it ended: a name of Stage
    answer: bool  # the answer ended there
    hops: tuple[TraceHop, ...]


def make_trace(end: SeenEnd) -> PacketTrace:
    """Make the trace of packets that were seen to end."""
    place = end.place
    steps = [step for hop in place.hops for step in _list_steps(hop)]
    if place.at:
        steps.append((place.at, TraceStep(ENDS, end.words.replace(f"{describe_probe(place.probe)} ", "", 1))))
    hops = tuple(
        TraceHop(computer, tuple(step for _computer, step in group))
        for computer, group in groupby(steps, key=lambda step: step[0])
    )
    return PacketTrace(describe_probe(place.probe), place.stage.name.lower(), place.answer, hops)


def _list_steps(hop: SeenHop) -> list[tuple[str, TraceStep]]:
    """List the steps of a hop, each with its computer: out of one, and into the next one if it was seen there."""
    words = "answer, " if hop.answer else ""
    by = f"{words}by {hop.left}, TTL {hop.ttl}" + (f", for {hop.target_mac}" if hop.target_mac else "")
    steps = [(hop.sender, TraceStep(LEFT, by))]
    if hop.arrived and hop.receiver:
        steps.append((hop.receiver, TraceStep(CAME, f"{words}by {hop.came}")))
    return steps
