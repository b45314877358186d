# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The links to other masters, as people are shown them: on /diagnostics, and as metrics.

Discovery knows who is there and how many heartbeats came. How long an answer takes, and how far two clocks are apart, is
asked by getCurrentTime, which upstream has too: one master at a time, and the more there are, the less often each.
"""

import math
from typing import Any, Dict, Iterable, Iterator, NamedTuple, Optional, Sequence, Set

from ...protocol.members import Members, normalize_uri
from ...protocol.messages import AnnouncedMaster, LinkQuality
from ...protocol.plain_text import plain, quote

EACH, ANY = 30.0, 5.0  # seconds from a question to one master to the next one to it, and to any master
LIMIT = 3.0  # seconds for an answer
NAME = 100  # characters of a name
MOST = 128  # links that are shown: more would be a flood
APART = (0.1, 0.5)  # seconds that two clocks are apart: tf extrapolates, and then messages are dropped


class ClockAnswer(NamedTuple):
    """The answer of a master to the question for its time."""

    seconds: float  # from the question to it, the connection included
    offset: float  # how far the clock there is ahead of the one here, in seconds

    @property
    def surely_apart(self) -> float:
        """Seconds that the clocks are apart at least: when the answer was written is not known better."""
        return max(0.0, abs(self.offset) - self.seconds / 2)


class LinkHealth(NamedTuple):
    """The link to one master."""

    name: str
    uri: str
    online: bool
    quality: float  # per cent of the heartbeats that came, -1 if the master promises none, or is not there
    silent: Optional[float]  # seconds since it was heard; None for not at all
    losses: int  # how often it was lost
    answer: Optional[ClockAnswer]


class LinkList(NamedTuple):
    """All links, or as many as are shown."""

    links: Sequence[LinkHealth]
    left_out: int = 0


def read_answer(value: Any, began: float, seconds: float) -> ClockAnswer:
    """Read the answer of getCurrentTime; the sender may be hostile. `began`: the wall clock here. Raises ValueError."""
    if not isinstance(value, list) or len(value) != 2 or not isinstance(value[1], float):
        raise ValueError("it does not give its time")
    if not (math.isfinite(value[1]) and 0.0 <= value[1] < 2**32):
        raise ValueError(f"its time is {value[1]:g}")
    return ClockAnswer(seconds, value[1] - began - seconds / 2)


class Health:
    """The history of the links so far."""

    def __init__(self, own_uri: str, members: Members) -> None:
        self._own_uri, self._members = normalize_uri(own_uri), members
        self._losses: Dict[str, int] = {}
        self._answers: Dict[str, ClockAnswer] = {}
        self._asked: Dict[str, float] = {}  # in the order of the questions
        self._last = -ANY

    def take_event(self, change: str, before: Optional[AnnouncedMaster], master: AnnouncedMaster) -> None:
        """Take an event of discovery. `before`: the master as it was."""
        was_online = before is not None and before.online
        if was_online and not master.online and self._is_other(master):
            self._losses[master.uri] = self._losses.get(master.uri, 0) + 1
        if not master.online:
            self._answers.pop(master.uri, None)
        if change == "removed":
            self._asked.pop(master.uri, None)
            if self._members.master(master.uri) is None:
                self._losses.pop(master.uri, None)

    def question(self, masters: Iterable[AnnouncedMaster], now: float) -> Optional[AnnouncedMaster]:
        """The master to ask now for its time: the one whose turn it is."""
        if now - self._last < ANY:
            return None
        there = [master for master in masters if master.online and self._is_other(master)]
        due = [master for master in there if now - self._asked.get(master.uri, -EACH) >= EACH]
        if not due:
            return None
        chosen = min(due, key=lambda master: self._asked.get(master.uri, -math.inf))
        self._asked[chosen.uri] = self._last = now
        return chosen

    def take_answer(self, uri: str, answer: Optional[ClockAnswer]) -> None:
        """Take an answer, or None for a question without an answer."""
        if answer is None or uri not in self._asked:
            self._answers.pop(uri, None)
        else:
            self._answers[uri] = answer

    def links(self, masters: Iterable[AnnouncedMaster], links: Iterable[LinkQuality]) -> LinkList:
        """The links to the masters that are listed, and to those of the fleet that are not there. No name is there twice."""
        heard: Dict[str, LinkQuality] = {}
        for link in links:  # a robot that is heard from two addresses has two
            best = heard.get(link.uri)
            heard[link.uri] = link if best is None or link.silent < best.silent else best
        found = [self._describe_link(master, heard.get(master.uri)) for master in masters if self._is_other(master)]
        found += self._absent_links({normalize_uri(link.uri) for link in found})
        found.sort(key=lambda link: (self._members.master(link.uri) is None, link.name))  # those of the fleet first
        named: Dict[str, LinkHealth] = {}
        for seen in found:
            named.setdefault(seen.name, seen)
        return LinkList(list(named.values())[:MOST], max(0, len(named) - MOST))

    def _absent_links(self, there: Set[str]) -> Iterator[LinkHealth]:
        """The links to the masters of the fleet that are not listed."""
        for robot in self._members.robots:
            if robot.name and self._own_uri not in robot.uris and not there.intersection(robot.uris):
                losses = sum(count for uri, count in self._losses.items() if normalize_uri(uri) in robot.uris)
                yield LinkHealth(plain(robot.name, NAME), min(robot.uris, default=""), False, -1.0, None, losses, None)

    def _describe_link(self, master: AnnouncedMaster, link: Optional[LinkQuality]) -> LinkHealth:
        quality = link.quality if link is not None and master.online else -1.0
        silent = link.silent if link is not None else None
        losses, answer = self._losses.get(master.uri, 0), self._answers.get(master.uri)
        planned = self._members.master(master.uri) is not None
        name = plain(master.name, NAME) if planned else quote(master.name, NAME - 2)
        return LinkHealth(name, master.uri, master.online, quality, silent, losses, answer)

    def _is_other(self, master: AnnouncedMaster) -> bool:
        return normalize_uri(master.uri) != self._own_uri
