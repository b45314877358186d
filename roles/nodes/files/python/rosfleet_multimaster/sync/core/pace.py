# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The pace of questions to another master for its changes, however fast it answers.

Free of sockets, threads and clocks: times are arguments, in seconds of a clock that never steps.
"""

BURST, RATE = 20, 20.0  # answers at once, and answers a second after these
WHOLE = 20  # a whole state counts as so many answers
SHARE = 4  # the pause after an answer, in times of the processor time that it took
EARLY = 1.0  # seconds until the next question, if an answer without news came early


class Pace:
    """The pace of the questions to one master."""

    def __init__(self) -> None:
        self._left, self._at = float(BURST), 0.0

    def next(self, now: float, took: float, whole: bool, early: bool) -> float:
        """The time of the next question, after an answer. `took`: seconds of a processor for it.

        `whole`: it was a whole state. `early`: it had no news, and did not wait for them.
        """
        self._left = min(BURST, self._left + (now - self._at) * RATE) - (WHOLE if whole else 1)
        self._at = now
        return now + max(-self._left / RATE, took * SHARE, EARLY if early else 0.0)
