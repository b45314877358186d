# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""How soon something is asked again: another master for its changes, however fast it answers; a roscore that tells none.

Free of sockets, threads and clocks: times are arguments, in seconds of a clock that never steps.
"""

from collections import deque
from typing import Deque

BURST, RATE = 20, 20.0  # answers that are taken at once, and then a second
WHOLE = 20  # answers that one with a whole state counts for
SHARE = 4  # times as much as an answer took of a processor, nothing is read of this master
EARLY = 1.0  # seconds until the next question where an answer without news came before its time


class Pace:
    """The pace of the questions to one master."""

    def __init__(self) -> None:
        self._left, self._at = float(BURST), 0.0

    def next(self, now: float, took: float, whole: bool, early: bool) -> float:
        """The time of the next question, after an answer that took so many seconds of a processor.

        `whole`: it was a whole state. `early`: it had no news, though there was time to wait for some.
        """
        self._left = min(BURST, self._left + (now - self._at) * RATE) - (WHOLE if whole else 1)
        self._at = now
        return now + max(-self._left / RATE, took * SHARE, EARLY if early else 0.0)


POLLS = 100  # a look takes at most one part in so many of the time
SLOWEST = 5.0  # seconds between two looks at most
QUICK, QUICK_POLLS = 0.02, 4  # seconds between two polls, and the same part, in
LIVELY = 1.0  # seconds after a change of own nodes: changes come together
SAMPLES = 8  # looks, of which the quickest says what one costs: the others have waited for a processor


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
