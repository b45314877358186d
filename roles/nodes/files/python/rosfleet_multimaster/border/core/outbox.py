# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Messages on their way out: bounded, and at a rate. Of too many the oldest go, and are counted."""

from collections import deque
from typing import Deque, List, Optional, Set

BATCH = 1 << 16  # bytes of small messages that leave together
QUEUE = (100, 4 << 20)  # messages and bytes that wait for one connection
ALL = 48 << 20  # bytes that wait for all connections together


class Budget:
    """The bytes that all outboxes may hold together. Beyond it the fullest one loses what it has held longest."""

    def __init__(self, limit: int = ALL) -> None:
        self._limit, self._used = limit, 0
        self._boxes: Set[Outbox] = set()

    def take(self, box: "Outbox", size: int) -> None:
        """Count bytes of an outbox, or give them back."""
        self._used += size
        self._boxes.add(box)
        while size > 0 and self._used > self._limit:
            fullest = max(self._boxes, key=lambda one: one.size)
            if len(fullest) < 2:
                return
            fullest.drop_oldest()

    def forget(self, box: "Outbox") -> None:
        """Give back what an outbox holds: its connection has ended."""
        self._used -= box.size
        self._boxes.discard(box)


class Outbox:
    """Messages that wait for one connection."""

    def __init__(self, budget: Budget, newest: bool = False) -> None:
        """`newest`: one message is enough. One message is always taken, however large."""
        self._budget = budget
        self._most, self._limit = (1, 0) if newest else QUEUE
        self._waiting: Deque[bytes] = deque()
        self.size = self.dropped = 0

    def add(self, message: bytes) -> None:
        """Have a message sent after those that wait."""
        self._waiting.append(message)
        self.size += len(message)
        self._budget.take(self, len(message))
        while len(self._waiting) > self._most or (self.size > self._limit and len(self._waiting) > 1):
            self.drop_oldest()

    def drop_oldest(self) -> None:
        """Drop the message that has waited longest."""
        self.size -= len(self._waiting[0])
        self._budget.take(self, -len(self._waiting.popleft()))
        self.dropped += 1

    def take(self) -> bytes:
        """Return what is to be sent next: one message, or some small ones; empty where nothing waits."""
        batch: List[bytes] = []
        size = 0
        while self._waiting and (not batch or size + len(self._waiting[0]) <= BATCH):
            batch.append(self._waiting.popleft())
            size += len(batch[-1])
        self.size -= size
        self._budget.take(self, -size)
        return batch[0] if len(batch) == 1 else b"".join(batch)

    def close(self) -> None:
        """Hold nothing any more."""
        self._budget.forget(self)
        self._waiting.clear()
        self.size = 0

    def __len__(self) -> int:
        return len(self._waiting)


class Throttle:
    """Lets at most so many messages a second pass. The newest of those that came too early follows as soon as it may."""

    def __init__(self, rate: float) -> None:
        """`rate`: messages a second; 0: all of them."""
        self._period = 1.0 / rate if rate else 0.0
        self._free = 0.0  # when the next one may pass
        self._waiting: Optional[bytes] = None
        self.dropped = 0

    def pass_on(self, message: bytes, now: float) -> bool:
        """Say if a message may pass now; else it waits, in the place of the one that waited."""
        if self._waiting is not None:
            self.dropped += 1
            self._waiting = None
        if now < self._free:
            self._waiting = message
            return False
        self._free = now + self._period
        return True

    @property
    def due(self) -> Optional[float]:
        """When the message that waits may pass; None where none waits."""
        return None if self._waiting is None else self._free

    def release(self, now: float) -> Optional[bytes]:
        """Return the message that waits, where it may pass now."""
        if self._waiting is None or now < self._free:
            return None
        message, self._waiting = self._waiting, None
        self._free = now + self._period
        return message
