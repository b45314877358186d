# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Robots that boot with their plug pulled out: one per network manager (inventory: tests/systems/alone).

The plug is between eth0 and the lab's network (lab/files/wire), since no container boots without a carrier else. ana's
address (ifupdown) is there without a carrier; bob's and cid's (networkd, NetworkManager) come with the carrier; dan's (netplan)
comes by DHCP.
"""

from __future__ import annotations

import contextlib
from concurrent.futures import ThreadPoolExecutor

from machines.podman import ROOT
from proofs.proof import NODES
from setups.links import wait_until
from subject import lab_of

INVENTORY = ROOT / "tests" / "systems" / "alone"
ROBOTS = {"ana": "192.168.24.21", "bob": "192.168.24.22", "cid": "192.168.24.23", "dan": "192.168.24.24"}
STATIC = ("ana", "bob", "cid")
SEEN, HEARD = 2.0, 5.0  # seconds from the moment when two robots have their network

DHCP = """
network:
  version: 2
  renderer: networkd
  ethernets:
    eth0: {dhcp4: true, accept-ra: false}
"""
# NetworkManager would make a connection of its own for every interface that it finds.
UNMANAGED = "[keyfile]\nunmanaged-devices=interface-name:wire0;interface-name:port0;interface-name:lab0\n"
# Something on a robot always wants the target of the network, and then the service of its manager waits for it.
UNIT = """
[Unit]
Wants=network-online.target
After=multimaster-roscore.service
[Service]
ExecStart=/bin/bash -lc 'exec {command}'
StandardOutput=truncate:/run/{name}.out
Restart=on-failure
[Install]
WantedBy=multi-user.target
"""


@contextlib.contextmanager
def boot_alone(name, **variables):
    """The robots after site.yml with these variables, and after a cold boot without a network."""
    with lab_of(name, INVENTORY) as lab:
        status, output = lab.play("site.yml", variables=variables)
        assert status == 0, output
        _prepare(lab)
        with ThreadPoolExecutor(len(ROBOTS)) as pool:
            list(pool.map(lambda robot: lab.reboot(f"{robot}-pc"), ROBOTS))
        yield lab


def _prepare(lab):
    """Put the plugs and the robots' own nodes in, for the next boot."""
    for robot, address in ROBOTS.items():
        others = " ".join(other for other in ROBOTS if other != robot)
        commands = {
            "alone": f"python3 /usr/local/share/lab/alone.py {robot} {address} {others}",
            "alone-relay": f"rosrun topic_tools relay /{robot}/talk /{robot}/back __name:={robot}_alone_relay",
        }
        files = {"/usr/local/share/lab/alone.py": (NODES / "programs/alone.py").read_text()}
        for name, command in commands.items():
            files[f"/etc/systemd/system/{name}.service"] = UNIT.format(name=name, command=command)
        if robot == "cid":
            files["/etc/NetworkManager/conf.d/lab.conf"] = UNMANAGED
        if robot == "dan":
            files["/etc/netplan/01-lab.yaml"] = DHCP
        for path, text in files.items():
            lab.run(f"{robot}-pc", f"cat > {path}", stdin=text)
        wire = "cp /usr/local/share/lab/wire.service /etc/systemd/system"
        lab.run(f"{robot}-pc", f"{wire} && systemctl --quiet enable wire alone alone-relay")


def events(lab, robot):
    """The events that a robot's node has reported: event -> when."""
    return {event: at for at, event in lab.output(f"{robot}-pc", "alone")}


def wait_for_events(lab, robot, *expected, seconds=60.0):
    """The same, as soon as these events are among it."""
    what = f"{robot}: {', '.join(expected)}"

    def look():
        found = events(lab, robot)
        return found if set(expected) <= set(found) else None

    return wait_until(look, seconds, what)


def moments(lab, robot, unit):
    """The times at which the start of a unit began and ended, by the steady clock."""
    names = ("InactiveExitTimestampMonotonic", "ActiveEnterTimestampMonotonic")
    shown = lab.run(f"{robot}-pc", f"systemctl show {unit} --property={','.join(names)}")
    of = dict(line.split("=") for line in shown.splitlines())
    return tuple(int(of[name]) / 1e6 for name in names)


def plug(lab, robot):
    lab.run(f"{robot}-pc", "ip link set port0 up")


def expect_seen(lab, robot, others, slack, since):
    """The other robots list this one within the time from the moment when both have their network, and hear its topic."""
    for other in others:
        there = wait_for_events(lab, other, "address", f"online {robot}-pc", f"heard {robot}")
        both = max(there["address"], wait_for_events(lab, robot, "address")["address"])
        seen, heard = there[f"online {robot}-pc"] - both, there[f"heard {robot}"] - both
        print(f"{robot} is listed by {other} after {seen:.2f} s, its topic is heard after {heard:.2f} s")
        assert seen <= SEEN + slack(since)
        assert heard <= HEARD + slack(since)
