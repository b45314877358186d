# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The clocks: one that never steps, the wall clock, and the processor time of the thread that asks."""

import time
from functools import lru_cache
from typing import Callable, TypeVar

monotonic, wall_clock, processor_time, sleep = time.monotonic, time.time, time.thread_time, time.sleep

FRESH = 1.0  # seconds

Value = TypeVar("Value")


def keep_fresh(read: Callable[[], Value]) -> Callable[[], Value]:
    """The same function, whose value is kept for FRESH at most: for values that take longer to read than to use."""
    kept = lru_cache(1)(lambda _moment: read())
    return lambda: kept(int(monotonic() / FRESH))
