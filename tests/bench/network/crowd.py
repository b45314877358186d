# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Many masters: twenty robots whose links open at the same moment, and one robot beside a hundred simulated masters."""

from __future__ import annotations

import json
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from links import SILENT, until
from subject import Lab, lab_of
from systems import HERE, PORT

ROBOTS, TOPICS = 20, 100
NAMES = [f"crowd-{number}" for number in range(ROBOTS)]
ADDRESSES = {name: f"192.168.31.{10 + number}" for number, name in enumerate(NAMES)}


def inventory(folder: Path) -> Path:
    """The inventory of the robots, each of one computer."""
    groups = {name.replace("-", "_"): {"hosts": {name: {"multimaster_address": ADDRESSES[name]}}} for name in ADDRESSES}
    shared = {"multimaster_common_network": "192.168.31.0/24"}
    path = folder / "crowd.json"
    path.write_text(json.dumps({"robots": {"children": groups, "vars": shared}}))
    return path


def meet(folder: Path, say) -> float:
    """Seconds from the moment when all links open until every roscore has all topics of all robots."""
    with lab_of("bench-crowd", inventory(folder)) as lab:
        status, output = lab.play("site.yml", "--forks", "4")
        assert status == 0, output
        say(f"{ROBOTS} robots are set up")
        with ThreadPoolExecutor(4) as pool:
            list(pool.map(lambda numbered: fill(lab, *numbered), enumerate(NAMES)))
            list(pool.map(lambda name: lab.run(name, "nft -f -", stdin=SILENT), NAMES))
            say("all links are cut")
            until(lambda: all(pool.map(lambda name: alone(lab, name), NAMES)), 120, "each robot is alone")
            text = (HERE / "programs" / "all_there.py").read_text()
            list(pool.map(lambda name: lab.run(name, "cat > /run/all_there.py", stdin=text), NAMES))
            for name in NAMES:
                lab.start(name, "all-there", f"python3 /run/all_there.py {ROBOTS} {TOPICS}")
            until(lambda: all(pool.map(lambda name: "ready" in said(lab, name), NAMES)), 60, "the programs that look")
        at = time.monotonic() + 30
        for name in NAMES:
            lab.run(name, "cat > /run/at.py", stdin=(HERE / "programs" / "at.py").read_text())
            lab.start(name, "open-link", f"python3 /run/at.py {at} nft delete table netdev lost")
        until(lambda: all(len(said(lab, name).split()) > 1 for name in NAMES), 300, "all topics everywhere")
        return max(float(said(lab, name).split()[1]) for name in NAMES) - at


def fill(lab: Lab, number: int, name: str) -> None:
    """A node with all topics of a robot."""
    lab.run(name, "cat > /run/giver.py", stdin=(HERE / "programs" / "giver.py").read_text())
    lab.start(name, "giver", f"python3 /run/giver.py {ADDRESSES[name]} {PORT}")
    until(lambda: "ready" in lab.run(name, "cat /run/giver.out", check=False), 60, "the giver")
    wanted = [[f"/crowd_{number}", f"/crowd_{number}/topic_{topic}"] for topic in range(TOPICS)]
    order = json.dumps(["register", wanted])
    ask = f"import socket; s = socket.create_connection(('{ADDRESSES[name]}', {PORT})).makefile('rw'); "
    ask += "import sys; s.write(sys.stdin.read() + chr(10)); s.flush(); print(s.readline())"
    lab.run(name, f'python3 -c "{ask}"', stdin=order)


def alone(lab: Lab, name: str) -> bool:
    """Whether the roscore has the topics of its own robot alone."""
    ask = "import os, xmlrpc.client as x; print(x.ServerProxy(os.environ['ROS_MASTER_URI']).getSystemState('/bench')[2][0])"
    return lab.run(name, f'python3 -c "{ask}"').count("/topic_") == TOPICS


def said(lab: Lab, name: str) -> str:
    """What all_there.py has printed."""
    return lab.run(name, "cat /run/all-there.out", check=False)
