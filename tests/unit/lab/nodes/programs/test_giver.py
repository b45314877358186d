# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The giver is ready where it listens, and nowhere else."""

import os
import re
import socket
import subprocess
import sys
from pathlib import Path

import pytest
import subject

from tests.unit.nodes.relay.ends import free_port

ROOT = Path(__file__).resolve().parents[5]
GIVER = ROOT / "lab" / "nodes" / "programs" / "giver.py"

# Ports that a program of the lab or of a test listens at, and datagrams are sent from, by the way they are written.
FIXED = re.compile(r'(?:\bPORT\b.* = .*?|^ +"|from: )(\d{5})\b', re.MULTILINE)
PROGRAMS = ("lab/nodes/*/*.py", "tests/bench/network/*.py", "tests/long/*.py", "tests/systems/exchanges/*.yml")


@pytest.fixture
def giver():
    """Starts a giver at a port of this computer: its output goes to one file with its errors, as in the lab."""
    running = []

    def start(port, path):
        with path.open("w") as output:
            words = [sys.executable, str(GIVER), "127.0.0.1", str(port)]
            environment = {**os.environ, "ROS_MASTER_URI": "http://127.0.0.1:1/"}
            running.append(subprocess.Popen(words, stdout=output, stderr=output, env=environment))
        return running[-1]

    yield start
    for process in running:
        process.kill()
        process.wait()


class Lab(subject.Lab):
    """A lab of one computer, this one, with a program as `start` has it."""

    def __init__(self, process, path):
        self.process, self.path = process, path

    def run(self, host, command, check=True, stdin=None):
        state = "active" if self.process.poll() is None else "inactive"
        return f"{state}\n{self.path.read_text()}"


@pytest.mark.slow
def test_a_giver_that_is_ready_is_connected_to(giver, tmp_path):
    for number in range(20):
        port, path = free_port(), tmp_path / str(number)
        Lab(giver(port, path), path).wait_until_ready("here", "giver")
        socket.create_connection(("127.0.0.1", port)).close()


def test_a_giver_whose_port_is_taken_is_not_ready(giver, tmp_path):
    """Its error has "ready" in it: "Address already in use"."""
    with socket.create_server(("127.0.0.1", 0)) as taken:
        process = giver(taken.getsockname()[1], tmp_path / "out")
        with pytest.raises(AssertionError, match="giver is inactive: .*already in use"):
            Lab(process, tmp_path / "out").wait_until_ready("here", "giver")


def test_no_fixed_port_is_in_the_kernels_own_range():
    """A connection of a node may have such a port, and then nothing can listen there: one of twenty robots in one set-up of twelve."""
    first, last = 32768, 60999  # net.ipv4.ip_local_port_range
    found = {
        (str(path.relative_to(ROOT)), int(port))
        for pattern in PROGRAMS
        for path in ROOT.glob(pattern)
        for port in FIXED.findall(path.read_text())
    }
    assert ("tests/bench/network/systems.py", 26000) in found and ("tests/systems/exchanges/states.yml", 25001) in found
    assert [entry for entry in found if first <= entry[1] <= last] == []
