# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""A watch over a fleet: the answers of all computers in, progress lines and the first loss out.

Pure. The module multimaster_watch documents the answer of a computer. Times are those of the computers' clocks. The
verification has compared these clocks before.
"""

from __future__ import annotations

import re
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import ceil
from typing import Any

from ..._faults.fault import Fault, list_advices
from ..._faults.foreseen import LOSSES, SUMMARIES, WATCHED

UNITS = {"": 1, "s": 1, "m": 60, "h": 3600, "d": 86400}
LEAST, MOST = 10, 7 * 86400  # seconds
# A round is the time between two progress lines.
SHORTEST, LONGEST, ROUNDS = 15, 300, 60  # seconds, seconds, number of them

TOGETHER = 10.0  # seconds: losses that have one reason are seen so close to each other
MOST_EVENTS = 500  # that a computer lists, as module_utils/_probe/watch/watch.py has it
LINES = 6  # events in the progress line of one round; the result has all

GROUP, MASTER = "group", "master"
RANKS = {kind: rank for rank, (_watched, kind) in enumerate(LOSSES)}  # nearest to the reason first


class UnreadableDuration(ValueError):
    """A text that is not a duration. The message names the expected form."""


@dataclass(frozen=True)
class Event:
    """A value of a computer was lost, or has returned."""

    kind: str
    name: str
    well: bool
    expected: str
    found: str
    time: float  # Unix time in seconds
    after: float  # seconds after the start of the watch


@dataclass(frozen=True)
class LostValue:
    """A value that is lost now."""

    kind: str
    name: str


@dataclass(frozen=True)
class WatchAnswer:
    """The answer of one computer's watch."""

    watched: int = 0
    seconds: float = 0.0
    events: tuple[Event, ...] = ()
    lost: tuple[LostValue, ...] = ()
    dropped: int = 0


def plan_rounds(duration: str) -> list[int]:
    """Read a duration such as 90, 90s, 15m, 2h or 1d, and split it into rounds. Raises UnreadableDuration.

    Return the ends of the rounds in seconds after the start; the last one is the duration. Progress is shown at each end.
    """
    match = re.fullmatch(r"(\d{1,6})\s*([smhd]?)", str(duration).strip())
    seconds = int(match[1]) * UNITS[match[2]] if match else 0
    if not LEAST <= seconds <= MOST:
        raise UnreadableDuration(
            f"verify_watch is {duration!r}, expected a time from 10s to 7d, such as 90s, 15m or 2h."
        )
    length = min(max(SHORTEST, ceil(seconds / ROUNDS)), LONGEST)
    return [min(end, seconds) for end in range(length, seconds + length, length)]


def list_events(answers: Mapping[str, WatchAnswer], known: Mapping[str, int] | None = None) -> list[tuple[str, Event]]:
    """List the events with their computers, in the order of time, without the first `known` ones of a computer."""
    events = [
        (name, event) for name, answer in answers.items() for event in answer.events[(known or {}).get(name, 0) :]
    ]
    return sorted(events, key=lambda one: one[1].time)


def describe_progress(answers: Mapping[str, WatchAnswer], seconds: int, known: Mapping[str, int]) -> str:
    """Describe how far the watch is, and the new losses. `known` has the number of events that were shown before, by computer."""
    lost = sum(len(answer.lost) for answer in answers.values())
    values = sum(answer.watched for answer in answers.values())
    state = f"{lost} lost now" if lost else "nothing is lost"
    last = min(max((answer.seconds for answer in answers.values()), default=0.0), seconds)
    head = f"watched {format_duration(last)} of {format_duration(seconds)}: {values} values on {len(answers)} computers, {state}"
    new = list_events(answers, known)
    more = [f"  and {len(new) - LINES} more"] if len(new) > LINES else []
    dropped = sum(answer.dropped for answer in answers.values())
    more += [f"  {dropped} events are not listed, since a computer lists {MOST_EVENTS} at most"] if dropped else []
    return "\n".join([head, *(f"  {describe_event(*event)}" for event in new[:LINES]), *more])


def describe_event(observer: str, event: Event) -> str:
    """Describe an event with its time."""
    sentence = _fill(observer, event)
    when = f"{_time(event.time)} ({format_duration(event.after)} after the start)"
    return f"{when}: it is over that {sentence}" if event.well else f"{when}: {sentence}"


def _fill(observer: str, event: Event) -> str:
    row = find_loss(event.kind)
    return row.sentence.format(place=observer, what=event.name, found=event.found, expected=event.expected)


def find_loss(kind: str) -> Fault:
    """Find the row of the table of faults for a kind of events."""
    return LOSSES.get((WATCHED, kind), SUMMARIES[WATCHED, "value"])


@dataclass(frozen=True)
class FirstLoss:
    """The first loss of a watch: its sentence, its row in the table of faults, and the computer where something is to be done."""

    sentence: str
    fault: Fault
    observer: str

    def advise(self, inventory: str = "") -> dict[str, Any]:
        """Return the steps to do and those to look at, as plain data. `inventory` is that of the run, as a command has it."""
        do, look = (self.fault.fill(one, (self.observer,), "", inventory) for one in (self.fault.do, self.fault.look))
        return {"id": self.fault.id, "page": self.fault.page, "do": list_advices(do), "look": list_advices(look)}


def describe_first_loss(events: Sequence[tuple[str, Event]]) -> str:
    """Return the moment and the place of the first loss; empty if nothing was lost."""
    first = find_first_loss(events)
    return first.sentence if first else ""


def find_first_loss(events: Sequence[tuple[str, Event]]) -> FirstLoss | None:
    """Find the first loss; None if nothing was lost.

    Several values may be lost together. The one nearest to the reason is named: a link before the heartbeats that come by it.
    """
    losses = [(observer, event) for observer, event in events if not event.well]
    if not losses:
        return None
    begin = losses[0][1]
    together = [entry for entry in losses if entry[1].time <= begin.time + TOGETHER]
    when = f"First loss at {_time(begin.time)}, {format_duration(begin.after)} after the start"
    observers = {observer for observer, event in together}
    kinds = {event.kind for _observer, event in together}
    masters = {event.name for _observer, event in together}
    observer, event = min(together, key=lambda entry: RANKS.get(entry[1].kind, len(RANKS)))
    if GROUP in kinds and kinds <= {GROUP, MASTER} and len(observers) > 1 and len(masters) > 1:
        row = SUMMARIES[WATCHED, "snooping"]
        return FirstLoss(f"{when}: {row.sentence.format(what=len(observers))} [{row.id}]", row, observer)
    row = find_loss(event.kind)
    return FirstLoss(f"{when}: {_place(observer, event, together)} [{row.id}].", row, observer)


def _place(observer: str, event: Event, together: Sequence[tuple[str, Event]]) -> str:
    """Describe the loss. For heartbeats, name the one computer that all losses have in common."""
    same = [entry for entry in together if entry[1].kind == event.kind]
    others = len(together) - 1
    masters, observers = {event.name for _observer, event in same}, {name for name, _event in same}
    if event.kind in (GROUP, MASTER, "port"):
        if len(masters) == 1 < len(observers):
            return f"{len(observers)} computers hear nothing of {event.name}"
        if len(observers) == 1 < len(masters):
            return f"{observer} hears nothing of {len(masters)} masters"
    return _fill(observer, event) + (f"; {others} more losses within {TOGETHER:g} s" if others else "")


def format_duration(seconds: float) -> str:
    """Write a duration as 4:21, or as 1:04:21."""
    whole = int(seconds)
    hours, rest = divmod(whole, 3600)
    return f"{hours}:{rest // 60:02}:{rest % 60:02}" if hours else f"{rest // 60}:{rest % 60:02}"


def _time(wall: float) -> str:
    try:
        return time.strftime("%H:%M:%S", time.localtime(wall))
    except (OverflowError, ValueError, OSError):  # a robot's answer may be no time of a clock
        return "a time that no clock has"
