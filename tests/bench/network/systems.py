# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The systems that are measured: two robots in the lab, with the nodes and roscores of each kind."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from machines.layout import Extra
from setups.links import wait_until
from subject import NODES, Lab, lab_of

HERE = Path(__file__).parent
ROOT = HERE.parents[2]
GIVER, TAKER = "ana-pc", "bob-pc"
ADDRESSES = {GIVER: "192.168.30.11", TAKER: "192.168.30.12"}
PORT = 26000  # of the giver; the kernel gives those from 32768 on to any program, so one of them may be taken
INTEROP = ROOT / "tests" / "interop" / "modules"


@dataclass(frozen=True)
class System:
    """One kind of nodes and roscores."""

    name: str  # in the files
    title: str  # for people
    roscore: str = "managed"  # multimaster_roscore
    upstream: bool = False  # nodes of multimaster_fkie, with its own defaults

    @property
    def units(self) -> dict[str, tuple[str, ...]]:
        """The services: of the nodes, of the roscore."""
        roscore = "multimaster-roscore" if self.roscore == "managed" else "foreign-roscore"
        ours = ("multimaster-discovery", "multimaster-sync", "multimaster-connections")
        return {"nodes": ("fkie-discovery", "fkie-sync") if self.upstream else ours, "roscore": (roscore,)}


MANAGED = System("managed", "bundled nodes, managed roscore")
EXISTING = System("existing", "bundled nodes, existing roscore", roscore="existing")
UPSTREAM = System("upstream", "multimaster_fkie 1.3.2", roscore="existing", upstream=True)


@contextlib.contextmanager
def running(system: System, fkie: Path | None = None) -> Iterator[Lab]:
    """Two robots that exchange all."""
    mounts = list_mounts(fkie) if system.upstream else ()
    with lab_of("bench-network", HERE / "inventory", {host: Extra(mounts=mounts) for host in ADDRESSES}) as lab:
        if system.roscore == "existing":
            for host in ADDRESSES:
                lab.run(host, "cp /usr/local/share/lab/foreign-roscore.service /etc/systemd/system")
                lab.run(host, "systemctl enable --now foreign-roscore.service")
        status, output = lab.play("site.yml", variables={"multimaster_roscore": system.roscore})
        assert status == 0, output
        for host in ADDRESSES if system.upstream else ():
            replace(lab, host)
        for host, other in ((GIVER, "bob_pc"), (TAKER, "ana_pc")):
            wait_until(lambda host=host, other=other: other in listed(lab, host), 60, f"{host} knows the other master")
        start_giver(
            lab, GIVER, GIVER
        )  # by its name, as the roscore: to multimaster_fkie, a node at another host is not the robot's
        yield lab


def list_mounts(fkie: Path | None) -> tuple[str, ...]:
    """The folders of this machine that a computer sees, to run the nodes of a checkout of multimaster_fkie."""
    messages = ROOT / "roles/nodes/files/python/fkie_multimaster_msgs"
    places = {"/opt/fkie": fkie, "/opt/interop": INTEROP, "/opt/messages/fkie_multimaster_msgs": messages}
    return tuple(f"{source}:{target}" for target, source in places.items())


def replace(lab: Lab, host: str) -> None:
    """Put the nodes of multimaster_fkie in the place of the bundled ones, with no parameter at all."""
    lab.run(host, "systemctl stop multimaster-sync multimaster-discovery")
    for node in ("discovery", "sync"):
        command = f"source /opt/interop/setup.bash; exec python3 /opt/fkie/fkie_master_{node}/nodes/master_{node}"
        lab.run(
            host,
            f"systemd-run --quiet --collect --unit=fkie-{node} --property=CPUAccounting=yes"
            f" --setenv=ROS_HOME=/run/bench bash -lc '{command}'",
        )


def listed(lab: Lab, host: str) -> str:
    """The masters that are online for a computer."""
    said = lab.run(host, "timeout -k 5 10 rosservice call /master_discovery/list_masters", check=False)
    return said.replace("-", "_") if said.count("online: True") == len(ADDRESSES) else ""


def start_giver(lab: Lab, host: str, address: str) -> None:
    """Start the program that registers on a computer as it is told."""
    lab.run(host, "cat > /run/giver.py", stdin=(NODES / "programs/giver.py").read_text())
    lab.start(host, "giver", f"python3 /run/giver.py {address} {PORT}")
    lab.wait_until_ready(host, "giver")


def take(lab: Lab, *words: object) -> list[object]:
    """Run taker.py; its output, line by line."""
    text = (HERE / "programs" / "taker.py").read_text()
    lab.run(TAKER, "cat > /run/taker.py", stdin=text)
    arguments = " ".join(map(str, words))
    lab.start(TAKER, "taker", f"python3 /run/taker.py {ADDRESSES[GIVER]} {PORT} {arguments}")
    wait_until(
        lambda: lab.run(TAKER, "systemctl is-active taker", check=False).strip() != "active", 1800, "all changes"
    )
    return [json.loads(line) for line in lab.run(TAKER, "cat /run/taker.out").splitlines() if line]
