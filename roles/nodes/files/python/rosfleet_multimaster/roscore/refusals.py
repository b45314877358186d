# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The requests that the roscore has refused since its start because they exceed a bound: counted, logged, reported.

A follower (roscore/changes.py) gets the counts as if they were a parameter, REFUSED: name of the bound -> how often.
"""

import threading
from collections import Counter
from typing import Callable, Dict, List
from typing import Counter as Counts

from ..edge.process import program
from ..protocol.mirror import REFUSED
from .core.bounds import BoundRefusal
from .core.registry import Record

PAUSE = 2.0  # seconds between two times that the counts are reported


class Refusals:
    """The counts."""

    def __init__(self, report: Callable[[List[Record]], None]) -> None:
        """`report(records)`: send records to the followers."""
        self._report, self._limited = report, program.LimitedLog()
        self._counts: Counts[str] = Counter()
        self._lock = threading.Lock()
        self._told: Dict[str, int] = {}
        self._due = 0.0

    def add(self, refusal: BoundRefusal) -> None:
        """Count a request that exceeds a bound; in any thread."""
        with self._lock:
            self._counts[refusal.bound or "value"] += 1
        self.say(f"beyond {refusal.bound}", f"a request is refused: {refusal}")

    def say(self, topic: str, why: str) -> None:
        """Log it, once in a while for each topic; in any thread."""
        with self._lock:
            self._limited.say("warning", topic, why)

    def records(self) -> List[Record]:
        """The counts, as the feed sends a parameter."""
        return [Record("parameter", REFUSED, value=self._told)] if self._told else []

    def tick(self, now: float) -> None:
        """Report new counts."""
        with self._lock:
            counts = dict(self._counts)
        if now >= self._due and counts != self._told:
            self._due, self._told = now + PAUSE, counts
            self._report(self.records())
