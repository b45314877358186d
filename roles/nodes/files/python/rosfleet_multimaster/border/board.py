# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""What this border offers to the others, for threads that wait for news."""

import os
import threading
from typing import Dict, List, Sequence, Tuple

from .core.channels import Offer


class OfferBoard:
    """What this border offers to each other one. Other threads wait for news."""

    def __init__(self, robots: Sequence[str]) -> None:
        self._epoch, self._count = os.urandom(8).hex(), 0
        self._offers: Dict[str, List[Offer]] = {robot: [] for robot in robots}
        self._changed = threading.Condition()
        self._revisions = dict.fromkeys(robots, f"{self._epoch} 0")

    def update(self, robot: str, offers: List[Offer]) -> None:
        """Say what a robot is offered now."""
        with self._changed:
            if offers != self._offers[robot]:
                self._count += 1
                self._offers[robot], self._revisions[robot] = offers, f"{self._epoch} {self._count}"
                self._changed.notify_all()

    def wait(self, robot: str, revision: str, seconds: float) -> Tuple[str, List[Offer]]:
        """Return the revision and the offers for a robot, as soon as the revision is another one, or after so many seconds."""
        with self._changed:
            self._changed.wait_for(lambda: self._revisions[robot] != revision, seconds)
            return self._revisions[robot], self._offers[robot]
