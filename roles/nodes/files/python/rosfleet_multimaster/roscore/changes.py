# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The method rosfleetChanges: a follower of the roscore asks for changes, and waits for the answer.

    rosfleetChanges(caller_id, epoch, revision, wait) -> [1, text, [epoch, revision, whole, records]]
    rosfleetChanges(caller_id, epoch, revision, wait, True)   the same, the records in texts of JSON, a few in each

It answers at once if something changed since that revision, and else within `wait` seconds, with no records. The answer to
another epoch or to a revision from long ago is the whole state, which replaces that of the follower.
"""

import threading
from typing import Any, Callable, ContextManager, Iterable, List, Sequence

from ..edge.clock import monotonic
from ..protocol.json_text import pack_rows
from .core.feed import Feed
from .core.registry import Record, Row, to_feed

LONGEST = 60.0  # seconds of waiting
WAITING = 8  # callers that wait at once
LOOK = 1.0  # seconds between two looks for callers that have left


class Changes:
    """The feed, and the callers that wait for it."""

    def __init__(
        self,
        epoch: str,
        lock: ContextManager[Any],
        state: Callable[[], Iterable[Record]],
        caller: Callable[[], Any],
    ) -> None:
        """`state()`: all records, read with the lock of the registrations held. `caller()`: the caller of this thread."""
        self._feed, self._lock, self._state, self._caller = Feed(epoch), lock, state, caller
        self._changed = threading.Condition()
        self._waiting = 0

    def add(self, records: Sequence[Record]) -> None:
        """Add the changes of one call. The lock of the registrations is held."""
        rows = to_feed(records)
        if rows:
            with self._changed:
                self._feed.add(rows)
                self._changed.notify_all()

    def answer(self, *arguments: Any) -> List[Any]:
        """The method."""
        try:
            _caller_id, epoch, revision, wait, *more = arguments
            seconds = min(max(float(wait), 0.0), LONGEST)
            if not isinstance(epoch, str) or not isinstance(revision, int) or more not in ([], [False], [True]):
                raise ValueError
            convert = pack_rows if more == [True] else _to_xmlrpc
        except (TypeError, ValueError):
            return [-1, "expected: caller_id, epoch (text), revision (int), wait (seconds), packed (bool, optional)", 0]
        caller = self._caller()
        if not caller.is_own:
            return [-1, "only programs of this computer get changes", 0]
        with self._changed:
            records = self._feed.records_since(epoch, revision)
            if records == [] and seconds:
                if self._waiting >= WAITING:
                    return [-1, f"{WAITING} callers wait already", 0]
                self._waiting += 1
                try:
                    records = self._wait(epoch, revision, monotonic() + seconds, caller)
                finally:
                    self._waiting -= 1
            if records is not None:
                return [1, "changes", [self._feed.epoch, self._feed.revision, False, convert(records)]]
        return self._whole(convert)

    def _wait(self, epoch: str, revision: int, end: float, caller: Any) -> Any:
        """Wait for records until `end`. The lock of the feed is held, but not while this sleeps."""
        records: Any = []
        while records == [] and monotonic() < end and not caller.has_left():
            self._changed.wait(min(LOOK, max(0.0, end - monotonic())))
            records = self._feed.records_since(epoch, revision)
        return records

    def _whole(self, convert: Callable[[Sequence[Row]], Any]) -> List[Any]:
        with self._lock:
            records, revision = to_feed(self._state()), self._feed.revision
        return [1, "whole state", [self._feed.epoch, revision, True, convert(records)]]


def _to_xmlrpc(rows: Sequence[Row]) -> List[Row]:
    """Records for XML-RPC, which has no None: a parameter that is not set has no value there."""
    return [row[:-1] if row[-1] is None else row for row in rows]
