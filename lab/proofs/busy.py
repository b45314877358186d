# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The factor by which something takes longer because the machine is busy with other things.

Limits in tests are those of a machine that has time. With other work, a computation takes longer than its processor
time. A thread compares the two all the while, and a limit becomes longer by what this makes of some work. On a machine that
has time, limits stay as they are.
"""

from __future__ import annotations

import threading
import time

PERIOD = 0.25  # seconds between two samples
WORK = 0.02  # seconds of processor time of a sample
WITHIN_A_LIMIT = 1.5  # seconds of processor time within the work of a limit; the rest of it is waiting
REPORTED = 0.1  # seconds that are worth a line: a demonstration has its limits, too
MOST = 5.0  # seconds by which a limit is longer at most


class Busy:
    """Samples the machine until the end of the block."""

    def __init__(self) -> None:
        self._samples: list[tuple[float, float]] = []  # when, elapsed time by processor time
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._watch, daemon=True)

    def __enter__(self) -> Busy:
        self._thread.start()
        return self

    def __exit__(self, *_exception: object) -> None:
        self._end.set()
        self._thread.join()

    def _watch(self) -> None:
        while not self._end.wait(PERIOD):
            began, worked = time.monotonic(), time.thread_time()
            while time.thread_time() - worked < WORK:
                pass
            self._samples.append((began, (time.monotonic() - began) / WORK))

    def slack(self, since: float) -> float:
        """Seconds by which a limit is longer, for what has been measured since then (steady clock)."""
        samples = [slowness for at, slowness in self._samples if at >= since]
        slowness = sum(samples) / len(samples) if samples else 1.0
        more = min(max(0.0, slowness - 1.0) * WITHIN_A_LIMIT, MOST)
        if more >= REPORTED:
            print(f"limits are {more:.2f} s longer: the machine took {slowness:.1f} times as long as when it has time")
        return more
