# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""usage.py UNIT...: prints as JSON the use of resources by processes of services: processor time in seconds, memory in bytes
(proportional set size), threads, open descriptors. The kernel's own account per service is missing in some containers.
"""

import json
import os
import sys
from pathlib import Path

units = {f"/{unit}.service" for unit in sys.argv[1:]}
found = {"seconds": 0.0, "bytes": 0, "processes": 0, "threads": 0, "descriptors": 0}
for folder in Path("/proc").glob("[0-9]*"):
    try:
        if not any(unit in (folder / "cgroup").read_text() for unit in units):
            continue
        fields = (folder / "stat").read_text().rpartition(")")[2].split()
        threads, descriptors = (len(os.listdir(folder / name)) for name in ("task", "fd"))
        rollup = (folder / "smaps_rollup").read_text().splitlines()
    except OSError:  # it has ended
        continue
    found["seconds"] += (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
    found["bytes"] += 1024 * sum(int(line.split()[1]) for line in rollup if line.startswith("Pss:"))
    found["threads"] += threads
    found["descriptors"] += descriptors
    found["processes"] += 1
print(json.dumps(found))
