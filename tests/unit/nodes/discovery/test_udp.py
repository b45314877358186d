# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Multicast with real sockets, in a network namespace of its own."""

import os
import pathlib
import shutil
import subprocess
import sys

import pytest

NODES = pathlib.Path(__file__).parents[4] / "roles/nodes/files"
IN_NAMESPACE = """
import socket, sys, time
from rosfleet_multimaster.discovery.udp import Udp
group = sys.argv[1]
pinned = Udp(group, 11511, "192.168.1.1", True)
second = Udp(group, 11511, "192.168.1.1", True)
elsewhere = Udp(group, 11511, "10.0.0.1", True)

def heard(udp, wait=0.3):
    end, found = time.monotonic() + wait, []
    while time.monotonic() < end:
        for opened in udp.sockets:
            found += udp.receive(opened)
        time.sleep(0.01)
    return [(d.data, d.source, d.multicast) for d in found]

pinned.send(b"group", None)
assert heard(pinned) == [(b"group", ("192.168.1.1", 11511), True)], "its own multicast comes back"
assert heard(second) == [(b"group", ("192.168.1.1", 11511), True)], "a second node of the computer hears it"
assert heard(elsewhere) == [], "the other interface does not"
elsewhere.send(b"other network", None)
assert heard(pinned) == [], "multicast of another interface is dropped"
assert heard(elsewhere) == [(b"other network", ("10.0.0.1", 11511), True)]
elsewhere.send(b"unicast", "10.0.0.1")
assert [(data, multicast) for data, _source, multicast in heard(elsewhere)] == [(b"unicast", False)]
try:
    Udp(group, 11511, "192.168.9.9", True)
except OSError as problem:
    assert "192.168.9.9" in str(problem)
else:
    raise AssertionError("an address that is nowhere")
"""


@pytest.mark.slow
@pytest.mark.skipif(
    os.geteuid() != 0 or shutil.which("unshare") is None or shutil.which("ip") is None,
    reason="needs root, unshare and ip",
)
@pytest.mark.parametrize("group", ["226.0.0.0", "224.0.0.1"])
def test_multicast_stays_on_the_pinned_interface(group):
    setup = (
        "ip link set lo up && ip link add name one type veth peer name one-end && ip address add 192.168.1.1/24 dev one && ip link set one up"
        " && ip link set one-end up && ip link add name two type veth peer name two-end && ip address add 10.0.0.1/24 dev two && ip link set two up"
        ' && ip link set two-end up && exec "$@"'
    )
    command = ["unshare", "--net", "sh", "-c", setup, "sh", sys.executable, "-c", IN_NAMESPACE, group]
    done = subprocess.run(
        command,
        env={**os.environ, "PYTHONPATH": str(NODES / "python")},
        timeout=30,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
