# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The processor time that the messages of a robot take in one turn of the loop, and in the long run."""

from typing import Optional

from ...edge.core.efforts import Efforts

SHARE, OWN_SHARE = 0.5, 0.9  # of one processor: of another robot, and of this one
SLICE = 0.005  # seconds that one connection takes at once
BURST = 0.01  # seconds that a robot takes in one turn of the loop, so that all others have theirs soon
SAID = 10.0  # seconds for which it is reported


def make_efforts(own: str) -> Efforts:
    """Return the accounts of all robots. `own`: this one."""
    return Efforts(SHARE, BURST, others={own: OWN_SHARE})


class Effort:
    """The account of a robot. Who has taken too much waits for the next turn, or until its share has made up for it."""

    def __init__(self, robot: str, efforts: Efforts) -> None:
        self._robot, self._efforts = robot, efforts
        self._turn, self._in_turn = 0, 0.0  # the number of the turn, and seconds in it
        self._waited_at = -SAID

    def spend(self, seconds: float, now: float, turn: int) -> None:
        """Count so much time of the processor."""
        self._efforts.spend(self._robot, seconds, now)
        self._in_turn = seconds + (self._in_turn if turn == self._turn else 0.0)
        self._turn = turn

    def find_wait(self, now: float, turn: int) -> Optional[float]:
        """Return the seconds until it may go on, 0 for the next turn; None if it may now."""
        wait = self._efforts.find_wait(self._robot, now)
        if wait:
            self._waited_at = now
            return wait
        return 0.0 if turn == self._turn and self._in_turn >= BURST else None

    def is_slowed(self, now: float) -> bool:
        """True if it had to wait for its share a short while ago."""
        return now - self._waited_at < SAID
