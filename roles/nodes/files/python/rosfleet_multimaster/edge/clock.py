# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The clocks: one that never steps, the wall clock, and the processor time of the thread that asks."""

import time

monotonic, wall_clock, processor_time, sleep = time.monotonic, time.time, time.thread_time, time.sleep
