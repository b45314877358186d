# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Messages on their way out: bounded. Of too many the oldest go, and are counted."""

from collections import deque
from typing import Deque, List

from .budget import Budget

BATCH = 1 << 16  # bytes of small messages that leave together
QUEUE = (100, 4 << 20)  # messages and bytes that wait for one connection


class Outbox:
    """Messages that wait for one connection, and those that are being sent."""

    def __init__(self, budget: Budget, newest: bool = False) -> None:
        """`newest`: one message is enough. One message is always taken, however large."""
        self._budget = budget
        self._most, self._limit = (1, 0) if newest else QUEUE
        self._waiting: Deque[bytes] = deque()
        self.size = self.dropped = 0  # bytes that wait, messages
        self.messages = self.sent = 0  # that have left, and bytes
        self._front, self._at = b"", 0  # the bytes that are being sent, and how many of them have been

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
        """Drop the waiting messages."""
        while self._waiting:
            self.drop_oldest()

    def find_due(self) -> memoryview:
        """Return the bytes to send now: one message or some small ones, or the rest of them; empty if nothing waits."""
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
        """So many of the due bytes have been sent."""
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
        """The number of messages that wait."""
        return len(self._waiting)
