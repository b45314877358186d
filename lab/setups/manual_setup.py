# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Robots that a person sets up without the collection, as sections 3.2 and 3.3 of the report IRI-TR-15-1 say."""

import contextlib
import io
import shlex
import tarfile

from machines import containers
from machines.podman import ROOT, podman

GROUP = "224.0.0.1"
FOLDER = "/opt/by_hand"
ROSCORE, DISCOVERY, SYNC = "by-hand-roscore", "by-hand-discovery", "by-hand-sync"


def programs_of(discovery, sync):
    """The programs of a robot, by their units, of the commands of its nodes."""
    return {ROSCORE: "roscore", DISCOVERY: f"{discovery} _mcast_group:={GROUP}", SYNC: sync}


BUNDLED = programs_of(
    *(f"env PYTHONPATH={FOLDER} python3 -m rosfleet_multimaster.master_{node}" for node in ("discovery", "sync"))
)


@contextlib.contextmanager
def robots(lab, addresses, programs, before="true", masters=None):
    """Robots of these computers, {name: address}, until the end of the block; then all is as before.

    `before` is a command of the shell that starts each program. The programs run on `masters`, by default on all computers.
    """
    masters = list(masters or addresses)
    names = "".join(f"{address} {name}\n" for name, address in addresses.items())
    for host in addresses:
        podman(
            "exec",
            "-i",
            containers.container(lab.name, host),
            "bash",
            "-c",
            f"mkdir -p {FOLDER} && tar -x -C {FOLDER}",
            stdin=_nodes(),
        )
        lab.run(host, "cp /etc/hosts /etc/hosts.before && cat >> /etc/hosts", stdin=names)
        lab.run(host, "sysctl -q -w net.ipv4.icmp_echo_ignore_broadcasts=0")
    try:
        for unit, command in programs.items():
            for host in masters:
                start(lab, host, unit, f"{before}; exec {command}")
                if unit == ROSCORE:  # a person waits for it, and upstream's nodes end without one
                    lab.run(host, "until (: < /dev/tcp/127.0.0.1/11311) 2> /dev/null; do sleep 0.2; done")
        yield
    finally:
        for host in addresses:
            lab.run(host, f"systemctl stop {' '.join(reversed(programs))}; systemctl reset-failed", check=False)
            lab.run(host, f"cat /etc/hosts.before > /etc/hosts; rm -r /etc/hosts.before {FOLDER}")
            lab.run(host, "sysctl -q -w net.ipv4.icmp_echo_ignore_broadcasts=1")


def start(lab, host, unit, command):
    """Start a program as the person does, in a terminal with the robot's ROS_MASTER_URI."""
    line = f"export ROS_MASTER_URI=http://{host}:11311; {command}"
    lab.run(host, f"systemd-run --quiet --collect --setenv=HOME=/root --unit {unit} bash -c {shlex.quote(line)}")


def _nodes() -> bytes:
    """The bundled nodes and messages as an archive."""
    buffer = io.BytesIO()
    with tarfile.open(fileobj=buffer, mode="w") as archive:
        archive.add(
            ROOT / "roles/nodes/files/python", ".", filter=lambda entry: None if "__pycache__" in entry.name else entry
        )
    return buffer.getvalue()
