# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Messages on their way out: bounded. Of too many the oldest go, and are counted."""

from collections import deque
from typing import Deque, Dict, List, Optional, Protocol, Set, Tuple

BATCH = 1 << 16  # bytes of small messages that leave together
QUEUE = (100, 4 << 20)  # messages and bytes that wait for one connection
LATCHED = 128 << 20  # bytes of messages that are kept for who comes later
ALL = 32 << 20  # bytes that all connections together hold: what waits, what is being sent, and what is being read


class Payer(Protocol):
    """A connection, as the budget sees it."""

    address: str  # of the other end
    progress: float  # when bytes of what is being sent have left it for the last time

    @property
    def size(self) -> int:
        """Bytes that it can do without."""

    @property
    def is_sending(self) -> bool:
        """True if it holds what is being sent, besides."""

    @property
    def is_stuck(self) -> bool:
        """True if nothing of it has left for long."""

    def shrink(self) -> None:
        """Hold less."""

    def end(self, why: str) -> None:
        """Hold nothing, since others need the memory."""


class Budget:
    """The bytes that all connections may hold together. A message counts once, however many hold it.

    Beyond the limit those that read nothing for long end, then the fullest of the computer that has most loses what waits and what is being
    read, then the one that reads nothing for longest ends.
    """

    def __init__(self, limit: int = ALL) -> None:
        self._limit, self.used = limit, 0
        self._latched = 0
        self.payers: Set[Payer] = set()
        self._held: Dict[int, Tuple[bytes, int]] = {}  # identity of a message -> the message, by how many it is held

    def hold(self, message: bytes) -> None:
        """Count a message that somebody holds."""
        _message, count = self._held.get(id(message), (message, 0))
        self._held[id(message)] = (message, count + 1)
        if not count:
            self.change(len(message))

    def release(self, message: bytes) -> None:
        """Somebody holds a message no more."""
        _message, count = self._held[id(message)]
        if count > 1:
            self._held[id(message)] = (message, count - 1)
        else:
            del self._held[id(message)]
            self.change(-len(message))

    def latch(self, before: Optional[bytes], message: Optional[bytes]) -> bool:
        """Keep a message for who comes later in the place of another one; False where all of these are too many bytes, and neither is kept."""
        self._latched -= len(before or b"")
        if self._latched + len(message or b"") > LATCHED:
            return False
        self._latched += len(message or b"")
        return True

    def change(self, size: int) -> None:
        """Count bytes besides; below 0 they are given back."""
        self.used += size
        while size > 0 and self.used > self._limit:
            held: Dict[str, int] = {}  # by address: many connections of one computer are one
            for payer in self.payers:
                held[payer.address] = held.get(payer.address, 0) + payer.size
            fullest = max(self.payers, key=lambda payer: (held[payer.address], payer.size), default=None)
            sending = (payer for payer in self.payers if payer.is_sending)
            slowest = min(sending, key=lambda payer: payer.progress, default=None)
            if fullest is not None and fullest.size and not (slowest and slowest.is_stuck):
                fullest.shrink()
            elif slowest is not None:
                slowest.end("it does not read, and others need the memory")
            else:
                return


class Outbox:
    """Messages that wait for one connection, and what is being sent."""

    def __init__(self, budget: Budget, newest: bool = False) -> None:
        """`newest`: one message is enough. One message is always taken, however large."""
        self._budget = budget
        self._most, self._limit = (1, 0) if newest else QUEUE
        self._waiting: Deque[bytes] = deque()
        self.size = self.dropped = 0  # bytes that wait, messages
        self.messages = self.sent = 0  # that have left, and bytes
        self._front, self._at = b"", 0  # what is being sent, and how much of it has been

    @property
    def is_sending(self) -> bool:
        """True if something has left in part."""
        return bool(self._front)

    def say(self, header: bytes) -> None:
        """Have a header sent before all that waits."""
        self._replace_front(self._front[self._at :] + header)

    def add(self, message: bytes) -> None:
        """Have a message sent after those that wait."""
        self._waiting.append(message)
        self.size += len(message)
        self._budget.hold(message)
        while len(self._waiting) > self._most or (self.size > self._limit and len(self._waiting) > 1):
            self.drop_oldest()

    def drop_oldest(self) -> None:
        """Drop the message that has waited longest."""
        self._release(self._waiting.popleft())
        self.dropped += 1

    def drop_all(self) -> None:
        """Drop what waits."""
        while self._waiting:
            self.drop_oldest()

    def find_due(self) -> memoryview:
        """Return what is to be sent now: one message or some small ones, or the rest of them; empty where nothing waits."""
        if self._at == len(self._front):
            batch: List[bytes] = []
            size = 0
            while self._waiting and (not batch or size + len(self._waiting[0]) <= BATCH):
                batch.append(self._waiting.popleft())
                size += len(batch[-1])
            self.size -= size
            self._replace_front(batch[0] if len(batch) == 1 else b"".join(batch))
            for message in batch:
                self._budget.release(message)
            self.messages += len(batch)
        return memoryview(self._front)[self._at :]

    def count_sent(self, size: int) -> None:
        """So many bytes of what is due have been sent."""
        self._at += size
        self.sent += size
        if self._at == len(self._front):
            self._replace_front(b"")

    def close(self) -> None:
        """Hold nothing any more."""
        while self._waiting:
            self._release(self._waiting.popleft())
        self._replace_front(b"")

    def _replace_front(self, data: bytes) -> None:
        before, self._front, self._at = self._front, data, 0
        if data:
            self._budget.hold(data)
        if before:
            self._budget.release(before)

    def _release(self, message: bytes) -> None:
        self.size -= len(message)
        self._budget.release(message)

    def __len__(self) -> int:
        """How many messages wait."""
        return len(self._waiting)
