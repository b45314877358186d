# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The cost of the border: a topic that crosses by it, the same directly, and by topic_tools' relay, on two computers.

    python tests/bench/network/border.py

Prints a table: the age of messages where they arrive, and the share of a core that the border takes on each side. The link of 8 Mbit/s
is made by the kernel's own shaping (tc, tbf); without it that row is missing, and the table says so.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]
sys.path[:0] = [str(ROOT / "lab"), str(ROOT / "tests/bench")]

import measures  # noqa: E402
from machines.podman import LabError  # noqa: E402
from setups.links import wait_until  # noqa: E402
from subject import Lab, lab_of  # noqa: E402

HERE = Path(__file__).parent
ROBOT, STATION = "kobuki1-pc", "station-pc"
UNIT = "multimaster-border"
SECONDS = 15
#: title -> bytes of a message, messages a second of each topic, topics
LOADS = {
    "1 kB at 100 Hz": (1000, 100, 1),
    "1 MB at 30 Hz": (1_000_000, 30, 1),
    "200 topics of 200 bytes at 10 Hz": (200, 10, 200),
}
#: way -> the topic that is published, and the one that is heard
WAYS = {
    "directly": ("/direct/flow", "/direct/flow"),
    "by a relay": ("/direct/flow", "/relayed"),
    "by the border": ("/border/flow", "/kobuki1/border/flow"),
}
SLOW = "tc qdisc replace dev eth0 root tbf rate 8mbit burst 16kb latency 50ms"


def run_flow(
    lab: Lab, published: str, heard: str, load: tuple[int, int, int], *units: tuple[str, str]
) -> dict[str, float]:
    """Send one load; the ages in milliseconds, the share that came, and the share of a core of each unit (host, unit)."""
    size, rate, count = load
    for host in (ROBOT, STATION):
        lab.run(host, "cat > /run/flow.py", stdin=(HERE / "programs" / "flow.py").read_text())
    lab.start(STATION, "take", f"python3 /run/flow.py take {heard} {SECONDS} {count}")
    before = [measures.observe_units(lab, *unit)["seconds"] for unit in units]
    lab.start(ROBOT, "give", f"python3 /run/flow.py give {published} {size} {rate} {SECONDS} {count}")
    wait_until(lambda: lab.output(STATION, "take"), 150, "all has come")
    found = json.loads(lab.output(STATION, "take")[-1][1])
    sent = int(lab.output(ROBOT, "give")[-1][1].split()[1])
    found["came, %"] = 100 * found["count"] / sent
    for unit, was in zip(units, before, strict=True):
        found[f"{unit[1]} on {unit[0]}, % of a core"] = (
            100 * (measures.observe_units(lab, *unit)["seconds"] - was) / SECONDS
        )
    return found


def show(title: str, way: str, found: dict[str, float]) -> None:
    """Print one row."""
    shares = "; ".join(f"{name}: {value:.1f}" for name, value in found.items() if "core" in name)
    print(
        f"{title:<34} {way:<14} p50 {found['p50']:8.2f} ms  p99 {found['p99']:8.2f} ms  came {found['came, %']:5.1f} %  {shares}",
        flush=True,
    )


def main() -> int:
    """Exit status 1 where nothing could be measured."""
    try:
        with lab_of("bench-border", HERE / "border", {}) as lab:
            status, output = lab.play("site.yml")
            if status:
                raise LabError(f"site.yml has failed: {output[-600:]}")
            measure_all(lab)
    except (AssertionError, LabError) as problem:
        print(f"bench: {problem}", file=sys.stderr)
        return 1
    return 0


def measure_all(lab: Lab) -> None:
    """Measure each load on each way, and the slow link."""
    borders = ((ROBOT, UNIT), (STATION, UNIT))
    for title, load in LOADS.items():
        for way, (published, heard) in WAYS.items():
            if way == "by a relay" and load[2] > 1:
                continue  # it takes one topic
            if way == "by a relay":
                lab.start(STATION, "relay", "rosrun topic_tools relay /direct/flow /relayed")
            units = borders if way == "by the border" else ((STATION, "relay"),) if way == "by a relay" else ()
            show(title, way, run_flow(lab, published, heard, load, *units))
            if way == "by a relay":
                lab.stop(STATION, "relay")
    try:
        lab.run(ROBOT, SLOW)
    except AssertionError as problem:
        print(f"no slow link: {problem}")
        return
    load = (30_000, 1000, 1)
    title = "30 MB/s offered to 8 Mbit/s"
    show(title, "directly", run_flow(lab, "/direct/flow", "/direct/flow", load))
    show(title, "newest: true", run_flow(lab, "/newest/flow", "/kobuki1/newest/flow", load, *borders))


if __name__ == "__main__":
    sys.exit(main())
