# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The room for the states of all other masters, in registrations: each has a bound, and all of them have one together.

The threat: many masters, of few robots or of strangers, each within its own bound. A part is kept for each robot of the fleet, so
a master of it is taken whatever others send. Asked in the threads that fetch and follow.
"""

import threading
from typing import Container, Dict

from ..edge.core.shares import Shares
from ..protocol.members import Members

MOST_FOLLOWED = (
    10_000  # registrations in a state that is followed, of all nodes in it; a larger one is fetched as a whole
)
ALL = 200_000  # in all states together: some 250 MB, which is half of the unit's memory


class StateRoom:
    """The number of registrations that the state of each master may have, and has."""

    def __init__(self, members: Members, most: int = ALL) -> None:
        """`most`: in all states together."""
        self._members, self._lock = members, threading.Lock()
        self._shares = Shares(most, MOST_FOLLOWED, {member.robot for member in members.robots})
        self._held: Dict[str, int] = {}  # by the URI of the master

    def find(self, uri: str) -> int:
        """Return how many registrations the state of a master may have."""
        with self._lock:
            return self._held.get(uri, 0) + self._shares.find_room(self._find_party(uri))

    def hold(self, uri: str, size: int) -> bool:
        """Count the state of a master, in the place of the one before. False if it is too large, and the one before counts."""
        with self._lock:
            party, before = self._find_party(uri), self._held.get(uri, 0)
            if size > before + self._shares.find_room(party):
                return False
            self._shares.add(party, size - before)
            self._held[uri] = size
            return True

    def keep(self, masters: Container[str]) -> None:
        """Forget the states of all other masters."""
        with self._lock:
            for uri in [uri for uri in self._held if uri not in masters]:
                self._shares.remove(self._find_party(uri), self._held.pop(uri))

    def _find_party(self, uri: str) -> str:
        """Return whose a state is: a robot of the fleet, or a master of another one."""
        member = self._members.master(uri)
        return uri if member is None else member.robot
