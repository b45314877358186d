# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Answers that nobody should give, against the running nodes: each stays below 128 MB, and goes on. Takes six minutes.

The second robot gives them, at its planned address: a gzip bomb, 80,000 topics, twelve large states at once,
ever more changes on the quick way. Then it takes connections of the first robot's discovery from eight addresses. All of
it stays in the lab's internal network.
"""

import json
import os
import re
import subprocess
import time
from pathlib import Path

import pytest
from machines import containers
from setups.links import wait_until
from subject import lab_of

HERE = Path(__file__).parent
ROOT = HERE.parents[1]

LAB = os.environ.get("HOSTILE_LAB", "long-hostile")
VICTIM, PEER, ADDRESS = "kobuki1computer", "kobuki2computer", "192.168.1.229"
UNITS = ("multimaster-discovery", "multimaster-sync")
MOST = 128 * 1024  # kB that a node may have had at any time
SECONDS = 25
RATE, BURST = 20, 40  # answers of one master that are taken in a second, and at once: edge/patience.py

IDLE = f"""
import socket, time, xmlrpc.client
held = []
for number in range(51, 59):
    for _count in range(8):
        held.append(socket.create_connection(("{ADDRESS}", 11611), 5, source_address=(f"192.168.1.{{number}}", 0)))
began = time.monotonic()
print(xmlrpc.client.ServerProxy("http://{ADDRESS}:11611").masterContacts()[2], time.monotonic() - began)
"""


@pytest.fixture(scope="module")
def lab():
    with lab_of(LAB, ROOT / "inventory" / "single_computer") as found:
        status, output = found.play("site.yml", variables={"multimaster_strangers": "allow"})
        assert status == 0, output
        found.run(PEER, "systemctl stop multimaster-sync multimaster-discovery")
        yield found


def nodes(lab):
    """Of each node: process, and the most memory that it has had in kB."""
    found = {}
    for unit in UNITS:
        shown = lab.run(VICTIM, f"pid=$(systemctl show --value --property MainPID {unit}); cat /proc/$pid/status")
        found[unit] = [int(re.search(rf"^{key}:\s+(\d+)", shown, re.M)[1]) for key in ("Pid", "VmHWM")]
    return found


def hostile(lab, kind, masters):
    """Let the second robot answer so for a while; how often it was asked."""
    words = ["podman", "exec", "-i", containers.container(LAB, PEER), "python3", "-", ADDRESS, PEER, str(SECONDS), kind]
    script = (HERE / "hostile_peer.py").read_text(encoding="utf-8")
    done = subprocess.run(
        [*words, str(masters)], input=script, stdout=subprocess.PIPE, text=True, timeout=200, check=True
    )
    return json.loads(done.stdout)["asked"]


KINDS = [("bomb", 1), ("large", 12), ("topics20000", 1), ("topics80000", 1), ("changes", 1), ("wholes", 1)]


@pytest.mark.parametrize(("kind", "masters"), KINDS)
def test_no_answer_makes_a_node_large(lab, kind, masters):
    before, since = nodes(lab), time.time()
    asked = hostile(lab, kind, masters)
    after = nodes(lab)
    print(f"\n{kind}: asked {asked} times; peak in kB:", {unit: size for unit, (_pid, size) in after.items()})
    assert asked >= masters
    assert asked <= SECONDS * RATE + BURST or kind not in ("changes", "wholes")
    assert {unit: pid for unit, (pid, _size) in after.items()} == {unit: pid for unit, (pid, _size) in before.items()}
    assert all(size < MOST for _pid, size in after.values()), after
    if kind == "topics20000":
        said = lab.run(VICTIM, "journalctl --quiet --output cat --unit multimaster-sync")
        assert "more than 5000 registrations" in said
        assert len(re.findall(r"registered the|more registrations", said)) > 0
    if kind == "topics80000":  # one limit or another, the first that it hits
        said = lab.run(VICTIM, f"journalctl --quiet --output cat --unit multimaster-sync --since @{since:.0f}")
        assert re.search(r"answers more than is taken: .*; nothing new of it is taken", said), said


def test_idle_connections_of_eight_addresses_shut_no_member_out(lab):
    for number in range(51, 59):
        lab.run(PEER, f"ip address add 192.168.1.{number}/24 dev eth0")
    wait_until(
        lambda: "active" in lab.run(VICTIM, "systemctl is-active multimaster-discovery", check=False), 20, "discovery"
    )
    time.sleep(1)
    name, seconds = lab.run(PEER, "python3 -", stdin=IDLE).split()
    print(f"\nserved after {float(seconds):.2f} s, beside 64 idle connections")
    assert name == VICTIM
    assert float(seconds) < 2.0
