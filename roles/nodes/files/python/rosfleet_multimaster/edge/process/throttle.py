# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The throttle of a server: how much of a processor the requests of one robot may take, and those of all robots together.

Each request has a bound of its own. Many of them, one after the other, would take the whole processor all the same. So who
has taken more than its share waits before the next request is read, and nobody else does.
"""

import threading
from typing import Dict

from ..clock import monotonic, sleep

MOST = 256  # callers that have an account of their own; further ones share one
_LOOK = 0.5  # seconds between two looks of somebody who waits
_REST = ""  # the account of those


class Throttle:
    """The accounts of all callers, in seconds of a processor: what each has taken, and not paid back yet by waiting."""

    def __init__(self, share: float, together: float, burst: float, patience: float) -> None:
        """`share`, `together`: seconds a second, of one caller and of all together; `burst`: seconds that each has ahead.

        `patience`: seconds that somebody waits at most.
        """
        self._share, self._together, self._burst, self._patience = share, together, burst, patience
        self._debts: Dict[str, float] = {}
        self._at, self._lock = monotonic(), threading.Lock()

    def spend(self, caller: str, seconds: float) -> None:
        """Count what a request of a caller has taken."""
        with self._lock:
            self._pay_back()
            caller = caller if caller in self._debts or len(self._debts) < MOST else _REST
            self._debts[caller] = self._debts.get(caller, 0.0) + seconds

    def wait(self, caller: str) -> bool:
        """Wait until a caller may ask again. False where it would have to wait for longer than the patience lasts."""
        until = monotonic() + self._patience
        while True:
            with self._lock:
                rate = self._pay_back()
                account = caller if caller in self._debts or len(self._debts) < MOST else _REST
                seconds = (self._debts.get(account, 0.0) - self._burst) / rate
            if seconds <= 0.0:
                return True
            left = until - monotonic()
            if left <= 0.0:
                return False
            sleep(min(seconds, left, _LOOK))

    def _pay_back(self) -> float:
        """Have the time since the last look paid back; the rate, in seconds a second, of each who has to."""
        now = monotonic()
        rate = min(self._share, self._together / max(1, len(self._debts)))
        paid, self._at = (now - self._at) * rate, now
        self._debts = {caller: debt - paid for caller, debt in self._debts.items() if debt > paid}
        return min(self._share, self._together / max(1, len(self._debts)))
