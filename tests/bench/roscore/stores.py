# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The cost of a roscore's memory: the same calls with its journal, with sqlite3, with nothing, and with that of ROS.

    python tests/bench/roscore/stores.py [--calls 3000] [--rounds 3]

It makes a lab of its own and takes the kinds in turn, so that other work on the machine meets all of them.
"""

import argparse
import json
import os
import statistics
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]
sys.path.insert(0, str(ROOT / "lab"))

from machines import containers  # noqa: E402
from subject import lab_of  # noqa: E402

LAB, HOST = "bench-roscore", "kobuki1computer"
KINDS = {
    "plain": "roscore of ROS",
    "nothing": "ours, without a store",
    "journal": "ours, its journal",
    "normal": "ours, sqlite3, WAL, synchronous=NORMAL",
    "full": "ours, sqlite3, WAL, synchronous=FULL",
}


def measured(calls, kinds, rounds):
    """One dictionary of figures for each run."""
    with lab_of(LAB, ROOT / "inventory" / "single_computer") as lab:
        inside = containers.container(LAB, HOST)
        here = Path(__file__).parent
        for folder, names in ((ROOT / "roles/nodes/files", ["python"]), (here, ["calls.py", "with_sqlite.py"])):
            words = f"tar -c -C {folder} {' '.join(names)} | podman exec -i {inside} tar -x -C /tmp"
            subprocess.run(["bash", "-o", "pipefail", "-c", words], check=True)
        found = []
        for _round in range(rounds):
            for kind in kinds:
                text = lab.run(HOST, f"cd /tmp && PYTHONPATH=/tmp/python:$PYTHONPATH python3 calls.py {kind} {calls}")
                found.append({"kind": kind, "load": os.getloadavg()[0], **json.loads(text.splitlines()[-1])})
                print(json.dumps(found[-1]), file=sys.stderr)
        return found


def table(found, kinds):
    """The rows for README.md beside this file: medians of the rounds, and the worst of all."""
    lines = [
        "| | median | 99 % | worst | computing | given to write() | to the disk | after kill -9 |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for kind in kinds:
        runs = [run for run in found if run["kind"] == kind]
        names = ("median", "p99", "computing", "written", "disk")
        of = {name: statistics.median(run[name] for run in runs) for name in names}
        times = [of["median"], of["p99"], max(run["worst"] for run in runs), of["computing"]]
        kept = " ".join(sorted({f"{run['kept']} of {run['calls']}" for run in runs}))
        cells = [*(f"{time:.2f} ms" for time in times), *(f"{of[name]:,.0f} bytes" for name in names[3:]), kept]
        lines.append(f"| {KINDS[kind]} | {' | '.join(cells)} |")
    return "\n".join(lines)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--calls", type=int, default=3000)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=list(KINDS))
    options = parser.parse_args()
    found = measured(options.calls, options.kinds, options.rounds)
    print(f"load of the machine: {min(run['load'] for run in found):.1f} to {max(run['load'] for run in found):.1f}\n")
    print(table(found, options.kinds))


if __name__ == "__main__":
    main()
