# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The history of changes of a roscore, for its followers.

A call that changed something is one revision. A follower that knows a revision of this epoch gets the later ones. Without
one, or with one from before the history, it needs the whole state.
"""

from collections import deque
from typing import Any, Deque, List, Optional, Sequence

from .bounds import weigh

MOST = 10000  # records of the history
_LONG = 1000  # signs of a text that count as one more record


class Feed:
    """The last changes."""

    def __init__(self, epoch: str, most: int = MOST) -> None:
        """`epoch`: a new one for each start of the process."""
        self.epoch, self.revision = epoch, 0
        self._most, self._size = most, 0
        self._history: Deque[List[List[Any]]] = deque()  # the last one is that of `revision`

    def add(self, records: Sequence[List[Any]]) -> None:
        """Note the changes of one call."""
        self.revision += 1
        self._history.append(list(records))
        self._size += _measure(records)
        while self._size > self._most:
            self._size -= _measure(self._history.popleft())

    def records_since(self, epoch: str, revision: int) -> Optional[List[List[Any]]]:
        """The records after a revision; None if only the whole state helps."""
        behind = self.revision - revision
        if epoch != self.epoch or not 0 <= behind <= len(self._history):
            return None
        start = len(self._history) - behind  # a deque is quick at its ends, so it is not walked
        return [record for at in range(start, len(self._history)) for record in self._history[at]]


def _measure(records: Sequence[List[Any]]) -> int:
    """Records, and the weight of long values."""
    return sum(1 + (weigh(record[-1]) // _LONG if record[0] == "parameter" else 0) for record in records)
