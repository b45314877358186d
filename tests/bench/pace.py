# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The pace of this machine: a virtual one gets slower when its neighbours work, and no load average tells it.

The same program takes half as long again in one hour as in another one. So figures of different hours are compared by the
seconds of the same work, and by the time that the host has taken away.
"""

from __future__ import annotations

import os
import subprocess
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

# Starts of Python with what most programs import: what a run of Ansible does most, on both sides.
WORK: Sequence[str] = ("/usr/bin/python3", "-I", "-c", "import http.client, inspect, json, subprocess")
TIMES = 10  # for each core


def reference() -> float:
    """Seconds by the clock for the same work on all cores at once; it takes about one."""
    cores = os.cpu_count() or 1
    began = time.monotonic()
    with ThreadPoolExecutor(cores) as pool:
        list(pool.map(lambda _number: subprocess.run(WORK, check=True), range(cores * TIMES)))
    return time.monotonic() - began


def stolen(stat: str = "") -> float:
    """Seconds of all cores that the host has taken since the boot (steal, proc(5)); `stat` is the text of /proc/stat."""
    fields = (stat or Path("/proc/stat").read_text()).split(None, 9)
    return int(fields[8]) / os.sysconf("SC_CLK_TCK")
