# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Numbers that threads add to."""

import threading


class Count:
    """A number that grows."""

    def __init__(self) -> None:
        self.value = 0
        self._lock = threading.Lock()

    def add(self, more: int = 1) -> None:
        """Add to it; from any thread."""
        with self._lock:
            self.value += more
