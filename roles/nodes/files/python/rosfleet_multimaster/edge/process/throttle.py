# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The throttle of a server with threads: who has taken more of the processor than its share waits before its next request is read."""

import threading

from ..clock import monotonic, sleep
from ..core.efforts import Efforts

_LOOK = 0.5  # seconds between two looks of a caller that waits


class Throttle:
    """The accounts of all callers, and the wait of each in its own thread."""

    def __init__(self, share: float, together: float, ahead: float, patience: float) -> None:
        """`share`, `together`, `ahead`: as of Efforts; `patience`: seconds that a caller waits at most."""
        self.efforts = Efforts(share, ahead, together)
        self._patience, self._lock = patience, threading.Lock()

    def spend(self, caller: str, seconds: float) -> None:
        """Count the time that a request of a caller has taken."""
        with self._lock:
            self.efforts.spend(caller, seconds, monotonic())

    def wait(self, caller: str) -> bool:
        """Wait until a caller may ask again. False if it would have to wait for longer than the patience lasts."""
        until = monotonic() + self._patience
        while True:
            with self._lock:
                seconds = self.efforts.find_wait(caller, monotonic())
            if not seconds:
                return True
            left = until - monotonic()
            if left <= 0.0:
                return False
            sleep(min(seconds, left, _LOOK))
