# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The speed of a fleet's network: bundled nodes with each kind of roscore, and multimaster_fkie beside them.

python tests/bench/network/network.py [--fkie CHECKOUT] [--quick] [SYSTEM]...

Two robots in the lab, one system after the other. The programs that measure know nothing of the collection: they speak
with the roscores. Prints a table, and writes samples, machine and versions to .work/bench/network.json, the table beside
it, and a picture. `--keep` writes figures and pictures to docs/understand/performance as well; `make readme` then writes the
tables of the page. A system that is not measured this time keeps its figures there, with the machine and the commit that they
are of.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[3]
sys.path[:0] = [str(ROOT / "lab"), str(ROOT / "tests/bench")]

import crowd  # noqa: E402
import figures  # noqa: E402
import in_tree  # noqa: E402
import measures  # noqa: E402
import pace  # noqa: E402
import systems  # noqa: E402
from machines.podman import LabError  # noqa: E402
from setups.links import lossy  # noqa: E402
from subject import Lab  # noqa: E402
from systems import System  # noqa: E402

WORK = ROOT / ".work" / "bench"
#: what gets lost -> how nftables matches it
LOST = {"udp": "meta l4proto udp", "all": ""}
SYSTEMS = {system.name: system for system in (systems.MANAGED, systems.EXISTING, systems.UPSTREAM)}


def say(text: str) -> None:
    """A line of progress."""
    print(f"bench: {text}", flush=True)


def measure(system: System, fkie: Path | None, scale: float, found: dict[str, list[float]]) -> None:
    """All measurements of one system, into `found`. `scale`: how many samples, 1 for as many as are asked for."""
    count, full = max(5, int((50 if system.upstream else 300) * scale)), 15 if system.upstream else 300

    def note(lab: Lab, names: str, take: Callable[[], Any]) -> None:
        began = time.monotonic()
        taken = take()
        values = taken if isinstance(taken, dict) else {names: taken if isinstance(taken, list) else [taken]}
        found.update(values)
        (WORK / f"{system.name}.json").write_text(json.dumps(found) + "\n")  # what was measured, should the rest fail
        say(f"{system.name}: {', '.join(values)} ({time.monotonic() - began:.0f} s)")

    with systems.running(system, fkie) as lab:
        note(lab, "memory", lambda: measures.memory(lab, system))
        note(lab, "", lambda: measures.changes(lab, system, count))
        note(lab, "first", lambda: measures.first_messages(lab))
        for kind, match in LOST.items():
            with lossy(lab, systems.ADDRESSES, 30, match):
                note(lab, f"new_{kind}", lambda: measures.changes(lab, system, max(5, count // 5))["new"])
        note(lab, "", lambda: measures.losses(lab, 1 if system.upstream or scale < 1 else 5))
        note(lab, "cpu", lambda: idle(lab, system))
    with systems.running(system, fkie) as lab:
        note(lab, "fill", lambda: measures.fill(lab))
        note(lab, "memory_full", lambda: measures.memory(lab, system))
        note(lab, "new_full", lambda: measures.changes(lab, system, min(count, full))["new"])
        note(lab, "bytes", lambda: measures.bytes_per_change(lab, system, max(5, count // 10)))
        note(lab, "cpu_full", lambda: idle(lab, system))
    if system is systems.MANAGED and scale == 1:
        found["meet"] = crowd.meet(WORK, say)
        say(f"{system.name}: meet")


def idle(lab: Lab, system: System) -> float:
    """The share of a core of the nodes, and of what they cause in the roscore. The nodes are stopped afterwards."""
    shares = measures.cpu(lab, system)
    return shares["nodes"] + shares["caused"]


def machine() -> dict[str, Any]:
    """The machine and the versions that the figures depend on."""
    version = subprocess.run(
        ["git", "describe", "--always", "--dirty"], cwd=ROOT, capture_output=True, text=True, check=False
    )
    cpus = [
        line.split(":")[1].strip() for line in Path("/proc/cpuinfo").read_text().splitlines() if "model name" in line
    ]
    return {
        "date": time.strftime("%Y-%m-%d"),
        "cores": os.cpu_count(),
        "processor": cpus[0] if cpus else platform.machine(),
        "kernel": platform.release(),
        "collection": version.stdout.strip(),
        "load": os.getloadavg()[0],
        "reference": round(pace.reference(), 2),
    }


def write(report: dict[str, Any], folder: Path) -> str:
    """The report, the table and the picture; returns the table."""
    import draw  # matplotlib takes a second to load

    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "network.json"
    titles = {name: system.title for name, system in SYSTEMS.items()}
    report = figures.merged(json.loads(path.read_text()) if path.exists() else {}, report, titles)
    text = figures.table(report["systems"], report["titles"]) + "\n" + figures.crowd_table(report.get("crowd", []))
    in_tree.write(report, path)
    (WORK / "network.md").write_text(text)
    draw.pictures(report, folder)
    return text


def main() -> int:
    """Exit status 1 where a figure falls short."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("systems", nargs="*", choices=[*SYSTEMS, []], help="which ones (default: all that there are)")
    parser.add_argument("--fkie", type=Path, help="a checkout of multimaster_fkie 1.3.2, to be measured beside")
    parser.add_argument("--quick", action="store_true", help="a tenth of the samples, to try the programs")
    parser.add_argument("--keep", action="store_true", help="write the figures to docs/understand/performance")
    options = parser.parse_args()
    WORK.mkdir(parents=True, exist_ok=True)
    names = options.systems or [name for name in SYSTEMS if name != "upstream" or options.fkie]
    report: dict[str, Any] = {"machines": {}, "systems": {}}
    failed = False
    try:
        for name in names:
            report["machines"][name], report["systems"][name] = machine(), {}
            measure(SYSTEMS[name], options.fkie, 0.1 if options.quick else 1.0, report["systems"][name])
            write(report, WORK)  # a run of half an hour may be broken off
        if "managed" in names and not options.quick:
            report["crowd"] = crowd.simulated(say)
    except (AssertionError, LabError) as problem:
        print(f"bench: {problem}", file=sys.stderr)
        failed = True
    found = report["systems"]
    for folder in (WORK, in_tree.FOLDER) if options.keep and not failed else (WORK,):
        text = write(report, folder)
    print(f"\n{text}", flush=True)
    short = figures.missed(found)
    for line in short:
        say(f"falls short: {line}")
    return int(bool(short) or failed)


if __name__ == "__main__":
    sys.exit(main())
