# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The memory of a relay: all that it holds for others, and whose it is. Who has most pays, and each robot has a share."""

from typing import Collection, Dict, Mapping, Optional, Protocol, Set, Tuple

from ...edge.core.shares import Shares

ALL = 32 << 20  # bytes of messages: that wait, are being sent, or are being read
KEPT = (
    16 << 20,
    8 << 20,
)  # bytes that stay while a connection does, in all and of one robot: headers, definitions, calls
LATCHED = (128 << 20, 64 << 20)  # bytes of messages that are kept for who comes later, in all and of one robot
ENOUGH = 7 / 8  # of ALL, to which is made room at once: the search is not for each message
_TEXT = 80  # bytes of a text without its letters, at most


def weigh_fields(fields: Mapping[str, str]) -> int:
    """Return the bytes of memory of the fields of a header, at most: a letter has one in a text of ASCII, else up to four (PEP 393)."""
    return sum(_TEXT + len(text) * (1 if text.isascii() else 4) for item in fields.items() for text in item)


class Payer(Protocol):
    """A connection, as the budget sees it."""

    progress: float  # when bytes have left it for the last time

    @property
    def robot(self) -> str:
        """The robot at the other end."""

    @property
    def size(self) -> int:
        """Bytes that it can do without."""

    @property
    def is_sending(self) -> bool:
        """True if it also holds messages that are being sent."""

    @property
    def is_stuck(self) -> bool:
        """True if nothing of it has left for long."""

    def shrink(self) -> None:
        """Hold less."""

    def end(self, why: str) -> None:
        """Hold nothing, since others need the memory."""


class Budget:
    """The bytes that all connections may hold together. A message counts once, however many hold it.

    Beyond the limit those that read nothing for long end, then the fullest of the robot that has most loses messages that wait and those being
    read, then the one that reads nothing for longest ends. Bytes that cannot be given back are refused at once, by robot.
    """

    def __init__(self, limit: int = ALL, robots: Collection[str] = (), own: str = "") -> None:
        """`own`: this robot; `robots`: all of them."""
        self._limit, self.used = limit, 0
        self._kept, self._latched = Shares(*KEPT, robots, own), Shares(*LATCHED, robots, own)
        self.payers: Set[Payer] = set()
        self._held: Dict[int, Tuple[bytes, int]] = {}  # identity of a message -> the message, by how many it is held

    def hold(self, message: bytes) -> None:
        """Count a message that a connection holds."""
        _message, count = self._held.get(id(message), (message, 0))
        self._held[id(message)] = (message, count + 1)
        if not count:
            self.change(len(message))

    def release(self, message: bytes) -> None:
        """A connection holds a message no more."""
        _message, count = self._held[id(message)]
        if count > 1:
            self._held[id(message)] = (message, count - 1)
        else:
            del self._held[id(message)]
            self.change(-len(message))

    def keep(self, robot: str, size: int) -> bool:
        """Count bytes that stay for a robot; below 0 they are given back. False if these are too many: then no byte is counted."""
        if size > 0 and not self._kept.have_room(robot, size):
            return False
        self._kept.add(robot, size)
        return True

    def latch(self, robot: str, before: Optional[bytes], message: Optional[bytes]) -> bool:
        """Keep a robot's message for later listeners in the place of another one; False if these are too many bytes, and neither is kept."""
        self._latched.remove(robot, len(before or b""))
        if not self._latched.have_room(robot, len(message or b"")):
            return False
        self._latched.add(robot, len(message or b""))
        return True

    def change(self, size: int) -> None:
        """Count bytes besides; below 0 they are given back."""
        self.used += size
        if size > 0 and self.used > self._limit:
            self._make_room(int(self._limit * ENOUGH))

    def _make_room(self, limit: int) -> None:
        while self.used > limit:
            held: Dict[str, int] = {}  # by robot: many connections of one are one
            for payer in self.payers:
                held[payer.robot] = held.get(payer.robot, 0) + payer.size
            fullest = max(self.payers, key=lambda payer: (held[payer.robot], payer.size), default=None)
            sending = (payer for payer in self.payers if payer.is_sending)
            slowest = min(sending, key=lambda payer: payer.progress, default=None)
            if fullest is not None and fullest.size and not (slowest and slowest.is_stuck):
                fullest.shrink()
            elif slowest is not None:
                slowest.end("it does not read, and others need the memory")
            else:
                return
