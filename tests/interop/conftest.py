# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The lab of the interoperation tests: `make test-interop FKIE=<checkout of multimaster_fkie 1.3.2>`, or `MAS=<of fkie_mas 5.7.0>`."""

import dataclasses
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import fleet
import pytest
from machines import containers
from machines.layout import hosts_of, read_inventory
from upstream import MOUNTS, UPSTREAM

ROOT = Path(__file__).resolve().parents[2]
HERE = Path(__file__).parent


@pytest.fixture(scope="session", autouse=True)
def lab():
    """The robots, as the collection makes them, and then with upstream's nodes where they are to run."""
    inventory, mounts = HERE / "inventory", tuple(f"{source}:{target}" for target, source in MOUNTS.items())
    hosts = [dataclasses.replace(host, mounts=mounts) for host in hosts_of(read_inventory(inventory))]
    with containers.remove_at_end(fleet.LAB):
        containers.bring_up(fleet.LAB, hosts)
        with ThreadPoolExecutor() as pool:
            list(pool.map(lambda computer: computer.run(UPSTREAM.ready), fleet.COMPUTERS))
        connection = containers.write_inventory(fleet.LAB, hosts)
        done = subprocess.run(
            [Path(sys.executable).with_name("ansible-playbook"), "-i", inventory, "-i", connection, "site.yml"],
            cwd=ROOT,
            env={**os.environ, "ANSIBLE_CONFIG": str(ROOT / "ansible.cfg"), "ANSIBLE_NOCOLOR": "1"},
            capture_output=True,
            text=True,
            timeout=300,
            check=False,
        )
        assert done.returncode == 0, done.stdout + done.stderr
        with ThreadPoolExecutor() as pool:
            list(pool.map(fleet.Robot.begin, fleet.ROBOTS.values()))
        fleet.settled()
        yield


@pytest.fixture(autouse=True)
def fleet_rests(lab):
    """Nothing that a test started stays."""
    yield
    with ThreadPoolExecutor() as pool:
        list(pool.map(lambda computer: computer.stop("*"), fleet.COMPUTERS))
