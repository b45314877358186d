# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The memory of requests and answers of a server: who has no room for a large one waits for it, in its own thread."""

import contextlib
import threading
from typing import Iterator

from ..core.shares import Shares


class NoRoom(Exception):
    """There was no room for a large request or answer for as long as it may wait."""


class Room:
    """Bytes that threads take for a while, each for a robot."""

    def __init__(self, shares: Shares, small: int, patience: float) -> None:
        """`small`: bytes that are not counted, since there are at most as many as connections; `patience`: seconds."""
        self._shares, self._small, self._patience = shares, small, patience
        self.used = 0
        self._freed = threading.Condition()

    @contextlib.contextmanager
    def take(self, robot: str, size: int, waits: bool = True) -> Iterator[None]:
        """Take some bytes, or wait for them. Raises NoRoom. `waits`: False for bytes that are there already, and would stay meanwhile."""
        if size <= self._small:
            yield
            return
        with self._freed:
            if not self._freed.wait_for(lambda: self._shares.have_room(robot, size), self._patience * waits):
                raise NoRoom(f"{size:,} bytes are too many with the others that are under way")
            self._change(robot, size)
        try:
            yield
        finally:
            with self._freed:
                self._change(robot, -size)
                self._freed.notify_all()

    def _change(self, robot: str, size: int) -> None:
        self._shares.add(robot, size)
        self.used += size
