# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The offers of this relay to the others, for threads that wait for news."""

import os
import threading
from typing import Dict, List, Optional, Tuple

from .core.channels import Offer


class OfferBoard:
    """The offers to each other relay; nothing is offered before the own roscore was read."""

    def __init__(self) -> None:
        self._epoch, self._count = os.urandom(8).hex(), 0
        self._known: Dict[str, Tuple[str, List[Offer]]] = {}  # robot -> revision, offers
        self._changed = threading.Condition()

    def update(self, robot: str, offers: List[Offer]) -> None:
        """Set the present offers to a robot."""
        with self._changed:
            if robot not in self._known or offers != self._known[robot][1]:
                self._count += 1
                self._known[robot] = (f"{self._epoch} {self._count}", offers)
                self._changed.notify_all()

    def wait(self, robot: str, revision: str, seconds: float) -> Optional[Tuple[str, List[Offer]]]:
        """Return the revision and the offers for a robot, as soon as the revision is another one, or after so many seconds; None before."""
        with self._changed:
            self._changed.wait_for(lambda: self._known.get(robot, (revision,))[0] != revision, seconds)
            return self._known.get(robot)
