# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Shares of a limited number of connections, calls or bytes, by their holders.

A robot has many addresses, ports and connections, and is one party. All computers that belong to no robot are one, too. A half
is kept for the parties: each has its reserve there, whatever the others take. The other half is for who comes first.
"""

from collections import Counter
from typing import Collection, Optional


class Shares:
    """A limit, and the part of it that each party has taken."""

    def __init__(
        self,
        most: int,
        most_of_one: int,
        parties: Collection[str],
        own: str = "",
        for_own: Optional[int] = None,
        for_others: Optional[int] = None,
    ) -> None:
        """`own`: a party that is bounded only by the rest; `for_own`: kept for it, a quarter without a word.

        `for_others`: kept for the others together, without a word a quarter, or a half without an own party; each has one,
        however many they are.
        """
        others = [party for party in parties if party != own]
        kept = for_others if for_others is not None else most // 4 if own else most // 2
        self._kept = {party: max(1, kept // len(others)) for party in others}
        if own:
            self._kept[own] = most // 4 if for_own is None else for_own
        self._own, self._most_of_one = own, most_of_one
        self._left = most - sum(self._kept.values())  # for who comes first
        self.counts: Counter[str] = Counter()  # the holdings of each party

    def have_room(self, party: str, number: int = 1) -> bool:
        """True if a party may have so many more."""
        return number <= self.find_room(party)

    def find_room(self, party: str) -> int:
        """Return how many more a party may have."""
        count = self.counts[party]
        kept = max(0, self._kept.get(party, 0) - count)
        is_own = bool(self._own) and party == self._own
        more = kept + max(0, self._left)
        return more if is_own else max(kept, min(more, self._most_of_one - count))

    def add(self, party: str, number: int = 1) -> None:
        """A party has so many more."""
        self._left -= self._find_excess(party, number)
        self.counts[party] += number
        if not self.counts[party]:
            del self.counts[party]

    def remove(self, party: str, number: int = 1) -> None:
        """A party has so many fewer."""
        self.add(party, -number)

    def count(self, party: str) -> int:
        """Return how many a party has."""
        return self.counts[party]

    def _find_excess(self, party: str, number: int) -> int:
        """The amount by which a party would exceed its reserve."""
        kept, before = self._kept.get(party, 0), self.counts[party]
        return max(0, before + number - kept) - max(0, before - kept)
