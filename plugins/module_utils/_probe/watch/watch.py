# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause
"""A watch over one computer without its sockets and files: values and heartbeats with their times in, events out.

A watched value is known by a kind and a name. The value at the first look is the one to keep: the fleet was
verified before. Only if one value is known to be good, that one counts. Another value is a loss, and this one again is a
return. A heartbeat has two values: heard and silent.
"""

import typing

# A master counts as silent after so many heartbeats, and after so many seconds at least: a machine may be busy. The nodes
# wait for fewer, since they ask a silent master before they give it up.
MISSED = 4
QUIET = 5.0
# The same if the sender promises no rate, as a master of upstream's nodes with their default of 0.02 Hz.
UNPROMISED = 180.0

EVENTS = 500  # kept; a link that comes and goes for hours is counted beyond
SENDERS = 4096  # of heartbeats that are kept in mind; more would be a flood of another program

HEARD, SILENT = "heard", "silent"
GOOD = {
    "service": "active",
    "port": "open",
    "clock": "steady",
    "readings": "read",
}  # kind -> the value that counts, whatever the first one was

Key = typing.Tuple[str, str]  # kind and name
Plain = typing.Dict[str, typing.Any]


def silence(rate: float) -> float:
    """Return the seconds that a sender of `rate` heartbeats a second may be silent; 0 is no promise."""
    return max(QUIET, MISSED / rate) if rate > 0 else UNPROMISED


class Watch:
    """The first values, the present ones, and the events since the start."""

    def __init__(self, now: float, wall: float) -> None:
        self.began, self.wall = now, wall  # monotonic seconds, Unix time
        self.first: typing.Dict[Key, str] = {}
        self.lost: typing.Dict[Key, float] = {}  # -> the Unix time since when
        self.beats: typing.Dict[Key, typing.Tuple[float, float]] = {}  # the time of the last, seconds it may be silent
        self.events: typing.List[Plain] = []
        self.dropped = 0

    def hear(self, now: float, kind: str, name: str, rate: float) -> None:
        """Note a heartbeat; `rate` is the promised one, in heartbeats a second."""
        key = kind, name
        if key in self.beats or len(self.beats) < SENDERS:
            self.beats[key] = now, silence(rate)
            self.first.setdefault(key, HEARD)

    def beat(self, now: float, wall: float) -> bool:
        """Find the silent sources; True if one was lost just now. A loss began with the last heartbeat."""
        losses = 0
        for key, (last, limit) in self.beats.items():
            value = SILENT if now - last > limit else HEARD
            losses += self._look(key, value, wall - (now - last) if value == SILENT else wall)
        return bool(losses)

    def read(self, wall: float, values: typing.Mapping[Key, str]) -> bool:
        """Compare the values with those to keep; True if something was lost just now."""
        losses = 0
        for key, value in values.items():
            self.first.setdefault(key, GOOD.get(key[0], value))
            losses += self._look(key, value, wall)
        return bool(losses)

    def _look(self, key: Key, value: str, wall: float) -> bool:
        well = value == self.first[key]
        if well == (key not in self.lost):
            return False
        if well:
            del self.lost[key]
        else:
            self.lost[key] = wall
        self._note(key, value, well, wall)
        return not well

    def _note(self, key: Key, value: str, well: bool, wall: float) -> None:
        if len(self.events) >= EVENTS:
            self.dropped += 1
            return
        kind, name = key
        found = {"kind": kind, "name": name, "well": well, "expected": self.first[key], "found": value}
        self.events.append(dict(found, time=round(wall, 3), after=round(max(0.0, wall - self.wall), 1)))

    def report(self, now: float) -> Plain:
        """Return the losses and returns so far, as the module returns them."""
        return {
            "watched": len(self.first),
            "seconds": round(now - self.began, 1),
            "events": self.events,
            "dropped": self.dropped,
            "lost": [{"kind": kind, "name": name} for kind, name in sorted(self.lost)],
        }
