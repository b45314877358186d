# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The clocks: one that never steps, and the wall clock."""

import time

monotonic, wall_clock, sleep = time.monotonic, time.time, time.sleep
