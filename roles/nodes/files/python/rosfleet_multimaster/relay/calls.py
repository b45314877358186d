# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Calls of services on their way: bytes are copied between two connections until one of the two ends.

A call may be silent for long: a provider works, or a client keeps its connection for later. If there are too many of one
party, the one of it that is silent longest ends for a new one.
"""

import contextlib
import socket
from typing import Callable, Collection, Optional, Set, Tuple

from ..edge.clock import monotonic, processor_time
from ..edge.core.shares import Shares
from ..edge.loop import Loop
from .account import Account
from .wire import keep_alive

PIECE = 1 << 14  # bytes at once, and all that is held in each direction
MOST, MOST_OF_ONE = 200, 50  # calls at once, and those of one party
SILENT = 60.0  # seconds of silence after which a call ends for a new one
IDLE = 3600.0  # the same if no new call wants its place


class _End:
    """One of the two connections of a call. Incoming bytes wait until the other one has taken the earlier ones."""

    def __init__(self, call: "Call", loop: Loop, connection: socket.socket) -> None:
        self.connection, self.pending = connection, b""  # the bytes to send here
        self._call, self._loop = call, loop
        self._waiting = False  # for the turn of its robot
        connection.setblocking(False)
        with contextlib.suppress(OSError):
            keep_alive(connection)

    def watch(self, is_read: bool) -> None:
        """Have the loop call if something can be done here. `is_read`: incoming bytes are wanted now."""
        wanted = not self._waiting
        self._loop.watch_events(self.connection, self._on_ready, wanted and is_read, wanted and bool(self.pending))

    def flush(self) -> None:
        """Send the waiting bytes, as far as it goes. Raises OSError."""
        with contextlib.suppress(BlockingIOError):
            self.pending = self.pending[self.connection.send(self.pending) :]

    def _on_ready(self) -> None:
        if self._call.account.may_go_on:
            self._call.copy(self)
        else:
            self._waiting = True
            self._loop.watch_events(self.connection, self._on_ready, False, False)
            self._call.account.queue(self._go_on)

    def _go_on(self) -> None:
        self._waiting = False
        self._call.copy(self)


class Call:
    """A call: its client, and its provider as soon as that is reached."""

    def __init__(
        self,
        loop: Loop,
        account: Account,
        party: str,
        client: socket.socket,
        first: bytes,
        on_end: Callable[["Call"], None],
    ) -> None:
        """`account`: of the other robot; `first`: bytes that go to the provider before all others."""
        self.account, self.party, self.client = account, party, client
        self.size, self.heard, self.ended = len(first) + 2 * PIECE, monotonic(), False
        self._loop, self._first, self._on_end = loop, first, on_end
        self._ends: Optional[Tuple[_End, _End]] = None

    def start(self, provider: socket.socket) -> None:
        """Copy between the client and its provider from now on."""
        if self.ended:
            provider.close()
            return
        self.heard = monotonic()
        self._ends = _End(self, self._loop, self.client), _End(self, self._loop, provider)
        self._ends[1].pending, self._first = self._first, b""
        self.copy(self._ends[1])

    def copy(self, end: _End) -> None:
        """Send the waiting bytes at one end, and take those that have come there."""
        if self.ended or self._ends is None:
            return
        began, other = processor_time(), self._ends[0] if end is self._ends[1] else self._ends[1]
        try:
            end.flush()
            if not other.pending:
                self._take(end, other)
        except OSError:
            self.end()
        self.account.spend(processor_time() - began)
        if not self.ended:
            end.watch(not other.pending)
            other.watch(not end.pending)

    def _take(self, end: _End, other: _End) -> None:
        """Hand on the bytes that have come. Raises OSError."""
        try:
            other.pending = end.connection.recv(PIECE)
        except BlockingIOError:
            return
        if not other.pending:
            self.end()
            return
        self.heard = monotonic()
        other.flush()

    def end(self) -> None:
        """Close both connections."""
        if self.ended:
            return
        self.ended = True
        for end in self._ends or ():
            self._loop.watch_events(end.connection, self.end, False, False)
            end.connection.close()
        self.client.close()
        self._on_end(self)


class Calls:
    """The calls that go on, by parties: who calls here, or who is called."""

    def __init__(self, loop: Loop, parties: Collection[str]) -> None:
        self._loop, self._shares = loop, Shares(MOST, MOST_OF_ONE, parties)
        self._open: Set[Call] = set()

    def begin(self, account: Account, party: str, client: socket.socket, first: bytes) -> Optional[Call]:
        """Begin a call; None if there are too many of the party, or they hold too much."""
        if not self._shares.have_room(party):
            self._end_silent(party)
        size = len(first) + 2 * PIECE
        if not self._shares.have_room(party) or not account.budget.keep(account.robot, size):
            return None
        call = Call(self._loop, account, party, client, first, self._on_end)
        self._shares.add(party)
        self._open.add(call)
        return call

    def tick(self, now: float) -> None:
        """End those that are silent for very long."""
        for call in [call for call in self._open if now - call.heard > IDLE]:
            call.end()

    def _end_silent(self, party: str) -> None:
        longest = min((call for call in self._open if call.party == party), key=lambda call: call.heard, default=None)
        if longest is not None and monotonic() - longest.heard > SILENT:
            longest.end()

    def _on_end(self, call: Call) -> None:
        self._open.discard(call)
        self._shares.remove(call.party)
        call.account.budget.keep(call.account.robot, -call.size)
