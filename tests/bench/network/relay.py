# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The cost of the relay: a topic that crosses by it, the same directly, and by topic_tools' relay and throttle, on two computers.

    python tests/bench/network/relay.py [--fkie CHECKOUT]

With a checkout of multimaster_fkie 1.3.2, its nodes run on both, in the place of the bundled ones.

Prints a table: the age of messages where they arrive, and the share of a core that the relay takes on each side. The link of 8 Mbit/s
is made by the kernel's own shaping (tc, tbf); without it that row is missing, and the table says so.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]
sys.path[:0] = [str(ROOT / "lab"), str(ROOT / "tests/bench")]

import measures  # noqa: E402
from machines.layout import Extra  # noqa: E402
from machines.podman import LabError  # noqa: E402
from setups.links import wait_until  # noqa: E402
from subject import Lab, lab_of  # noqa: E402
from systems import list_mounts  # noqa: E402

HERE = Path(__file__).parent
ROBOT, STATION = "kobuki1-pc", "station-pc"
UNIT = "multimaster-relay"
PROVIDED = {"multimaster_provider": "fkie_existing", "multimaster_ros_setup": "/opt/interop/setup.bash"}
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
    "by topic_tools": ("/direct/flow", "/copied"),
    "by the relay": ("/relay/flow", "/kobuki1/relay/flow"),
}
SLOW = "tc qdisc replace dev eth0 root tbf rate 8mbit burst 16kb latency 50ms"
OFFERED = (30_000, 1000, 1)
#: what crosses beside it, at 10 Hz: title -> who publishes what, and who hears what
BESIDE = {
    "/cmd_vel beside it": (STATION, "/kobuki1/relay/cmd_vel", ROBOT, "/relay/cmd_vel"),
    "/odom beside it": (ROBOT, "/relay/odom", STATION, "/kobuki1/relay/odom"),
}
SMALL = (200, 10, 1)
RATE = 5  # messages a second, of 30


class Stream:
    """A load on its way from a robot to another one."""

    def __init__(self, lab: Lab, name: str, giver: str, published: str, taker: str, heard: str) -> None:
        self.lab, self.name, self.giver, self.published, self.taker, self.heard = (
            lab,
            name,
            giver,
            published,
            taker,
            heard,
        )
        for host in (giver, taker):
            lab.run(host, "cat > /run/flow.py", stdin=(HERE / "programs" / "flow.py").read_text())

    def start(self, load: tuple[int, int, int]) -> None:
        """Begin: bytes of a message, messages a second of each topic, topics."""
        size, rate, count = load
        take, give = f"take{self.name}", f"give{self.name}"
        self.lab.start(self.taker, take, f"python3 /run/flow.py take {self.heard} {SECONDS} {count}")
        self.lab.start(self.giver, give, f"python3 /run/flow.py give {self.published} {size} {rate} {SECONDS} {count}")

    def find_ages(self) -> dict[str, float]:
        """Return the ages in milliseconds, and the share that came, at the end."""
        wait_until(lambda: self.lab.output(self.taker, f"take{self.name}"), 150, "all has come")
        found: dict[str, float] = json.loads(self.lab.output(self.taker, f"take{self.name}")[-1][1])
        sent = int(self.lab.output(self.giver, f"give{self.name}")[-1][1].split()[1])
        found["came, %"] = 100 * found["count"] / sent
        return found


def run_flow(
    lab: Lab, published: str, heard: str, load: tuple[int, int, int], *units: tuple[str, str]
) -> dict[str, float]:
    """Send one load from the robot to the station; its ages, and the share of a core of each unit (host, unit)."""
    stream = Stream(lab, "", ROBOT, published, STATION, heard)
    before = [measures.observe_units(lab, *unit)["seconds"] for unit in units]
    stream.start(load)
    found = stream.find_ages()
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
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--fkie", type=Path, help="a checkout of multimaster_fkie 1.3.2, whose nodes run")
    fkie = parser.parse_args().fkie
    extras = {host: Extra((), list_mounts(fkie)) for host in (ROBOT, STATION)} if fkie else {}
    try:
        with lab_of("bench-relay", HERE / "relay", extras) as lab:
            status, output = lab.play("site.yml", variables=PROVIDED if fkie else None)
            if status:
                raise LabError(f"site.yml has failed: {output[-600:]}")
            measure_all(lab)
    except (AssertionError, LabError) as problem:
        print(f"bench: {problem}", file=sys.stderr)
        return 1
    return 0


def measure_all(lab: Lab) -> None:
    """Measure each load on each way, and the slow link."""
    relays = ((ROBOT, UNIT), (STATION, UNIT))
    for title, load in LOADS.items():
        for way, (published, heard) in WAYS.items():
            if way == "by topic_tools" and load[2] > 1:
                continue  # it takes one topic
            if way == "by topic_tools":
                lab.start(STATION, "topic-tools", "rosrun topic_tools relay /direct/flow /copied")
            units = relays if way == "by the relay" else ((STATION, "topic-tools"),) if way == "by topic_tools" else ()
            show(title, way, run_flow(lab, published, heard, load, *units))
            if way == "by topic_tools":
                lab.stop(STATION, "topic-tools")
    measure_rates(lab)
    try:
        for host in (ROBOT, STATION):
            lab.run(host, SLOW)
    except AssertionError as problem:
        print(f"no slow link: {problem}")
        return
    title = "30 MB/s offered to 8 Mbit/s"
    for way, published, heard in (
        ("directly", "/direct/flow", "/direct/flow"),
        ("newest: true", "/newest/flow", "/kobuki1/newest/flow"),
    ):
        beside = [Stream(lab, str(number), *ends) for number, ends in enumerate(BESIDE.values())]
        for stream in beside:
            stream.start(SMALL)
        show(title, way, run_flow(lab, published, heard, OFFERED, *(relays if way != "directly" else ())))
        for name, stream in zip(BESIDE, beside, strict=True):
            show(name, way, stream.find_ages())


def measure_rates(lab: Lab) -> None:
    """Measure a topic of 30 Hz of which some messages a second are wanted: by the relay, and by topic_tools' throttle on the robot."""
    load, title = LOADS["1 MB at 30 Hz"], f"1 MB at 30 Hz, {RATE} wanted"
    lab.start(ROBOT, "throttle", f"rosrun topic_tools throttle messages /direct/flow {RATE} /direct/slowed")
    show(title, "by throttle", run_flow(lab, "/direct/flow", "/direct/slowed", load, (ROBOT, "throttle")))
    lab.stop(ROBOT, "throttle")
    relays = ((ROBOT, UNIT), (STATION, UNIT))
    show(title, f"rate: {RATE}", run_flow(lab, "/rated/flow", "/kobuki1/rated/flow", load, *relays))


if __name__ == "__main__":
    sys.exit(main())
