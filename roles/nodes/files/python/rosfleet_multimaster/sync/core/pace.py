# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""How soon another master is asked again for its changes, however fast it answers.

Free of sockets, threads and clocks: times are arguments, in seconds of a clock that never steps.
"""

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
