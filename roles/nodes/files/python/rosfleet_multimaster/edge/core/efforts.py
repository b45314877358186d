# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The time of a processor that parties take: each has its share of it, and all of them have one together.

Each item has a bound of its own. Many of them, one after the other, would take the whole processor all the same. So a party
that has taken more than its share waits, and no other party does.

Shares (shares.py) are of things that are held and given back. Time cannot be given back: it is made up for by waiting. So the two are
two classes, and all doors use them.
"""

from typing import Dict, Mapping, Optional

MOST = 256  # parties that have an account of their own; further ones share one
REST = ""  # the account of those


class Efforts:
    """The accounts of all parties, in seconds of a processor: the time that each has taken, and has yet to pay back by waiting."""

    def __init__(
        self, share: float, ahead: float, together: float = float("inf"), others: Optional[Mapping[str, float]] = None
    ) -> None:
        """`share`, `together`: seconds a second, of one party and of all together; `ahead`: seconds that each has before it waits.

        `others`: parties with another share.
        """
        self._share, self._ahead, self._together, self._others = share, ahead, together, others or {}
        self._debts: Dict[str, float] = {}
        self._at = 0.0

    def __len__(self) -> int:
        """The number of parties with debts."""
        return len(self._debts)

    def spend(self, party: str, seconds: float, now: float) -> None:
        """Count the time that a party has taken."""
        self._pay_back(now)
        account = self._find_account(party)
        self._debts[account] = self._debts.get(account, 0.0) + seconds

    def find_wait(self, party: str, now: float) -> float:
        """Return the seconds until a party may go on, as far as it is known now; 0 if it may."""
        self._pay_back(now)
        account = self._find_account(party)
        return max(0.0, (self._debts.get(account, 0.0) - self._ahead) / self._find_rate(account))

    def _find_account(self, party: str) -> str:
        return party if party in self._debts or len(self._debts) < MOST else REST

    def _find_rate(self, account: str) -> float:
        """The seconds that a party with debts pays back in a second."""
        return min(self._others.get(account, self._share), self._together / max(1, len(self._debts)))

    def _pay_back(self, now: float) -> None:
        """Have the time since the last look paid back."""
        since, self._at = now - self._at, now
        left = ((party, debt - since * self._find_rate(party)) for party, debt in self._debts.items())
        self._debts = {party: debt for party, debt in left if debt > 0.0}
