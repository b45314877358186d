# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The relay as people are shown it: its status, its log, an entry of /diagnostics, and metrics."""

from functools import partial
from typing import Any, Dict, List, Mapping, Optional

from ..edge.display import Display
from ..edge.loop import DirectRunner, Loop, RecurringJob
from ..edge.process import program
from ..edge.process.systemd import notify
from ..protocol import metrics
from ..protocol.messages import DiagnosticEntry
from . import diagnostics
from .account import Accounts
from .core import report
from .feed import TopicFeed
from .given import GivenSide
from .parties import NAME, OTHERS, Parties
from .taken import TakenSide

STATUS = 5.0  # seconds between two lines of status
SLOWED = "its messages take more of the processor than its share, and wait"


class Overview:
    """Counts the messages of all feeds, and shows the figures if they are due."""

    def __init__(
        self,
        values: Mapping[str, Any],
        uri: str,
        loop: Loop,
        limited: program.LimitedLog,
        given: GivenSide,
        taken: TakenSide,
        own: Mapping[str, TopicFeed],
        parties: Parties,
        accounts: Accounts,
    ) -> None:
        """`values`: the parameters of the node; `uri`: of the own roscore; `own`: feeds of the topics of this node itself."""
        self._given, self._taken, self._parties, self._accounts = given, taken, parties, accounts
        self._slowed: List[str] = []  # robots whose messages cost too much
        self._states = RecurringJob(DirectRunner(), lambda: STATUS, self._say_status)
        self._display = Display(values, uri, NAME, loop, limited, self._make_entries, self._make_samples)
        for feed in own.values():
            self._display.open(partial(diagnostics.DiagnosticsPublisher, feed))

    def tick(self, now: float) -> Optional[float]:
        """Show all that is due; the time of the next look."""
        due = [self._states.tick(now), self._display.tick(now)]
        return min((time for time in due if time is not None), default=None)

    def end(self) -> None:
        """Take back the shown entries."""
        self._display.end()

    def list_feeds(self) -> List[TopicFeed]:
        """List the feeds of both sides. Called from any thread."""
        return [*list(self._given.feeds.values()), *list(self._taken.feeds.values())]

    def _list_passed(self) -> List[report.TopicCount]:
        return report.add_up(
            report.TopicCount(feed.topic, feed.messages, feed.size, feed.count_dropped()) for feed in self.list_feeds()
        )

    def _make_entries(self) -> List[DiagnosticEntry]:
        away = sorted(set(self._parties.peers) - set(self._taken.offers))
        kept_back: Dict[str, str] = {feed.topic: feed.problem for feed in self.list_feeds() if feed.problem}
        kept_back.update({robot or OTHERS: SLOWED for robot in self._accounts.list_slowed()})
        return [report.make_entry(away, len(self._parties.peers), self._list_passed(), kept_back)]

    def _make_samples(self) -> metrics.Samples:
        return report.make_samples(len(self._taken.offers), self._list_passed())

    def _say_status(self) -> None:
        before, self._slowed = self._slowed, self._accounts.list_slowed()
        for robot in sorted(set(self._slowed) - set(before)):
            program.LOG.warning("%s: %s", robot or OTHERS, SLOWED)
        notify(f"STATUS={self._make_entries()[0].message}; {self._taken.count_here()} topics of other robots are here")
