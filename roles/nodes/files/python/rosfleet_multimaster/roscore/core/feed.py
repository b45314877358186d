# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The history of changes of a roscore, for those who follow it.

A call that changed something is one revision. Who knows a revision of this epoch gets what came after it; who knows none,
or one that the history does not reach back to, needs the whole state.
"""

from collections import deque
from typing import Any, Deque, List, Optional, Sequence

from .bounds import weight

MOST = 10000  # records of the history
_LONG = 1000  # signs of a text that count as one more record


class Feed:
    """The last changes."""

    def __init__(self, epoch: str, most: int = MOST) -> None:
        """`epoch`: another one for each start of the process."""
        self.epoch, self.revision = epoch, 0
        self._most, self._held = most, 0
        self._history: Deque[List[List[Any]]] = deque()  # the last one is that of `revision`

    def add(self, records: Sequence[List[Any]]) -> None:
        """Note the changes of one call."""
        self.revision += 1
        self._history.append(list(records))
        self._held += _size(records)
        while self._held > self._most:
            self._held -= _size(self._history.popleft())

    def since(self, epoch: str, revision: int) -> Optional[List[List[Any]]]:
        """The records after a revision; None where only the whole state helps."""
        behind = self.revision - revision
        if epoch != self.epoch or not 0 <= behind <= len(self._history):
            return None
        start = len(self._history) - behind
        return [record for at in range(start, len(self._history)) for record in self._history[at]] if behind else []


def _size(records: Sequence[List[Any]]) -> int:
    """Records, and what long values count."""
    return sum(1 + (weight(record[-1]) // _LONG if record[0] == "parameter" else 0) for record in records)
