# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Many masters: twenty robots whose links open at the same moment, and one robot beside a hundred simulated masters."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from measures import held, usage
from setups.links import SILENT, wait_until
from subject import NODES, Lab, lab_of
from systems import GIVER, HERE, MANAGED, PORT, TAKER, start_giver

ROBOTS, TOPICS, MEETINGS = 20, 100, 5
AROUND = 20.0  # seconds before and after the links open
MASTERS, EXPORTED = (10, 30, 100), 50
GROUP = "226.0.0.0"
NAMES = [f"crowd-{number}" for number in range(ROBOTS)]
ADDRESSES = {name: f"192.168.31.{10 + number}" for number, name in enumerate(NAMES)}


def inventory(folder: Path) -> Path:
    """The inventory of the robots, each of one computer."""
    groups = {name.replace("-", "_"): {"hosts": {name: {"multimaster_address": ADDRESSES[name]}}} for name in ADDRESSES}
    shared = {"multimaster_common_network": "192.168.31.0/24"}
    path = folder / "crowd.json"
    path.write_text(json.dumps({"robots": {"children": groups, "vars": shared}}))
    return path


def meet(folder: Path, say: Callable[[str], None], times: int = MEETINGS) -> list[float]:
    """Seconds from the moment when all links open until every roscore has all topics of all robots, each time."""
    with lab_of("bench-crowd", inventory(folder)) as lab:
        status, output = lab.play("site.yml", "--forks", "4")
        assert status == 0, output
        say(f"{ROBOTS} robots are set up")
        with ThreadPoolExecutor(4) as pool:
            list(pool.map(lambda numbered: fill(lab, *numbered), enumerate(NAMES)))
            for program in ("all_there.py", "at.py"):
                text = (HERE / "programs" / program).read_text()
                list(pool.map(lambda name, text=text, to=program: lab.run(name, f"cat > /run/{to}", stdin=text), NAMES))
            wait_until(
                lambda: all(pool.map(lambda name: held(lab, name).count("/topic_") == ROBOTS * TOPICS, NAMES)),
                120,
                "all",
            )
        return [meeting(lab, say) for _number in range(times)]


def meeting(lab: Lab, say: Callable[[str], None]) -> float:
    """One time: all links are cut until each robot is alone, and open at the same moment.

    What the services take is that of forty seconds: what they put off until all have met is in it, and what they take idle.
    """
    with ThreadPoolExecutor(4) as pool:
        list(pool.map(lambda name: lab.run(name, "nft -f -", stdin=SILENT), NAMES))
        wait_until(lambda: all(pool.map(lambda name: alone(lab, name), NAMES)), 120, "each robot is alone")
        list(pool.map(lambda name: lab.start(name, "all-there", f"python3 /run/all_there.py {ROBOTS} {TOPICS}"), NAMES))
        list(pool.map(lambda name: lab.wait_until_ready(name, "all-there"), NAMES))
        before = processors(lab, pool)
        at = time.monotonic() + AROUND
        order = f"python3 /run/at.py {at} nft delete table netdev lost"
        list(pool.map(lambda name: lab.start(name, "open-link", order), NAMES))
        assert time.monotonic() < at, "the programs that open the links were started too late"
        wait_until(lambda: finished(lab), 300, "all topics everywhere")
        took = max(float(said(lab, name).split()[1]) for name in NAMES) - at
        time.sleep(max(0.0, at + AROUND - time.monotonic()))
        after = processors(lab, pool)
        assert all(pool.map(lambda name: held(lab, name).count("/topic_") == ROBOTS * TOPICS, NAMES)), (
            "not all is there"
        )
    shares = ", ".join(f"{unit} {after[unit] - before[unit]:.1f} s" for unit in before)
    say(f"{ROBOTS} robots have met in {took:.1f} s; processors: {shares}")
    return took


def processors(lab: Lab, pool: ThreadPoolExecutor) -> dict[str, float]:
    """Seconds of the processors that the services of all robots have taken so far: service -> seconds."""
    text, found = (NODES / "observers/usage.py").read_text(), {}
    for unit in (*MANAGED.units["nodes"], *MANAGED.units["roscore"]):
        of = list(pool.map(lambda name, unit=unit: json.loads(lab.run(name, f"python3 - {unit}", stdin=text)), NAMES))
        assert all(robot["processes"] for robot in of), f"{unit} does not run everywhere"
        found[unit] = sum(robot["seconds"] for robot in of)
    return found


def fill(lab: Lab, number: int, name: str) -> None:
    """A node with all topics of a robot."""
    start_giver(lab, name, ADDRESSES[name])
    wanted = [[f"/crowd_{number}", f"/crowd_{number}/topic_{topic}"] for topic in range(TOPICS)]
    order = json.dumps(["register", wanted])
    ask = f"import socket; s = socket.create_connection(('{ADDRESSES[name]}', {PORT})).makefile('rw'); "
    ask += "import sys; s.write(sys.stdin.read() + chr(10)); s.flush(); print(s.readline())"
    lab.run(name, f'python3 -c "{ask}"', stdin=order)


def alone(lab: Lab, name: str) -> bool:
    """True where the roscore has the topics of its own robot alone."""
    return held(lab, name).count("/topic_") == TOPICS


def said(lab: Lab, name: str) -> str:
    """The output of all_there.py."""
    return lab.run(name, "cat /run/all-there.out", check=False)


def finished(lab: Lab) -> bool:
    """True where all of all_there.py have ended. Looks seldom: each look is a process, and the robots need the cores."""
    time.sleep(2)
    return all(len(said(lab, name).split()) > 1 for name in NAMES)


def simulated(say: Callable[[str], None]) -> list[dict[str, float]]:
    """One robot beside 10, 30 and 100 simulated masters: what it takes per master, once it has all their topics."""
    rows = []
    with lab_of("bench-crowd", HERE / "inventory") as lab:
        status, output = lab.play("site.yml", variables={"multimaster_strangers": "allow"})
        assert status == 0, output
        lab.run(GIVER, "systemctl stop multimaster-sync multimaster-discovery")
        lab.run(GIVER, "cat > /run/simulated.py", stdin=(HERE / "programs" / "simulated.py").read_text())
        addresses = [f"192.168.30.{100 + number}" for number in range(max(MASTERS))]
        lab.run(GIVER, "".join(f"ip address add {address}/24 dev eth0; " for address in addresses))
        for count in MASTERS:
            lab.run(TAKER, "systemctl restart multimaster-roscore")
            time.sleep(10)
            lab.start(GIVER, "simulated", f"python3 /run/simulated.py {GROUP} {EXPORTED} {' '.join(addresses[:count])}")
            began = time.monotonic()
            wait_until(
                lambda count=count: held(lab).count("/simulated_") >= 2 * count * EXPORTED, 120, f"{count} masters"
            )
            there = time.monotonic() - began
            time.sleep(10)
            rows.append({"masters": count, "there": there, **steady(lab, count)})
            lab.stop(GIVER, "simulated")
            say(f"{count} simulated masters: {rows[-1]}")
    return rows


def steady(lab: Lab, count: int) -> dict[str, float]:
    """The costs of a robot while nothing changes: share of a core, bytes, packets a second."""

    def packets() -> int:
        return sum(map(int, lab.run(TAKER, "cat /sys/class/net/eth0/statistics/[rt]x_packets").split()))

    before, sent, began = usage(lab, MANAGED, "nodes"), packets(), time.monotonic()
    time.sleep(20)
    after, took = usage(lab, MANAGED, "nodes"), time.monotonic() - began
    return {
        "cpu": (after["seconds"] - before["seconds"]) / took,
        "memory": after["bytes"],
        "packets": (packets() - sent) / took / count,
    }
