# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The pause until a roscore that does not report its changes is read again.

Free of sockets, threads and clocks: times are arguments, in seconds of a clock that never steps.
"""

from collections import deque
from typing import Deque

POLLS = 100  # a look takes at most one part in so many of the time
SLOWEST = 5.0  # seconds between two looks at most
QUICK, QUICK_POLLS = 0.02, 4  # seconds between two polls, and the same part, in
LIVELY = 1.0  # seconds after a change of own nodes: changes come together
SAMPLES = 8  # looks, of which the quickest shows the cost of one: the others have waited for a processor


class PollPace:
    """The pace of the looks at a roscore."""

    def __init__(self, period: float) -> None:
        """`period`: seconds between two looks at least, unless something has just changed."""
        self._period = period
        self._took: Deque[float] = deque(maxlen=SAMPLES)
        self._lively_until = float("-inf")

    def pause(self, now: float, took: float, changed: bool = False) -> float:
        """Seconds until the next look, after one that took so long and ended now. `changed`: own nodes have."""
        self._took.append(took)
        if changed:
            self._lively_until = now + LIVELY
        cost = min(self._took)
        if now < self._lively_until:
            every = max(min(QUICK, self._period), cost * QUICK_POLLS)
        else:
            every = max(self._period, cost * POLLS)
        return max(min(every, SLOWEST) - took, QUICK / 2)
