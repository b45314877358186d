# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Parts of a machine's own kernel: links that lose and delay packets (netem), limits of units (cgroups).

ana's gateway and bob, after site.yml. Five minutes if nothing else runs.
"""

import contextlib
import re
from pathlib import Path

import pytest
from machines.layout import hosts_of, read_inventory
from setups.links import wait_until

INVENTORY = Path(__file__).with_name("pair")
BOB = "bob-pc"
CGROUP = "/sys/fs/cgroup/system.slice"
UNIT = "multimaster-watchdog"  # the one with the smallest limits
# Of a link of two computers, one end is named like the other.
LOSS = re.compile(r"(ana-gate|bob-pc) loses packets on the common network")
MEBIBYTE = 2**20
SIZES = {"K": 2**10, "M": 2**20, "G": 2**30}
# A program that is moved into a unit's cgroup, and there takes memory, or starts processes: it prints how many there were.
EATS = "import sys; held = [bytearray(b'x' * 2**20) for _number in range(int(sys.argv[1]))]; print(len(held))"
FORKS = """
import os, time
children = []
try:
    for number in range(40):
        child = os.fork()
        if not child:
            time.sleep(2)
            os._exit(0)
        children.append(child)
except BlockingIOError:
    pass
for child in children:
    os.waitpid(child, 0)
print(len(children))
"""


@pytest.fixture(scope="module")
def lab(new_machines):
    with new_machines("machines-kernel", hosts_of(read_inventory(INVENTORY)), INVENTORY) as found:
        found.write(BOB, "/root/eats.py", EATS)
        found.write(BOB, "/root/forks.py", FORKS)
        status, output = found.play("site.yml")
        assert status == 0, output
        yield found


def inside(unit, command):
    """The command, run in the cgroup of a unit."""
    return f"sh -c 'echo $$ >{CGROUP}/{unit}.service/cgroup.procs && exec {command}'"


def read(lab, unit, name):
    return lab.run(BOB, f"cat {CGROUP}/{unit}.service/{name}").strip()


def events(lab, unit, name, word):
    """A number of a cgroup's file with events."""
    return int(dict(line.split() for line in read(lab, unit, name).splitlines())[word])


@contextlib.contextmanager
def netem(lab, words):
    """bob's link is bad within the block, but for the lab's own way in."""
    lab.run(
        BOB,
        f"tc qdisc add dev eth0 root handle 1: prio bands 3 priomap {' '.join('2' * 16)}"
        f" && tc qdisc add dev eth0 parent 1:3 netem {words}"
        " && tc filter add dev eth0 parent 1: protocol ip prio 1 u32 match ip dst 192.168.20.254/32 flowid 1:1",
    )
    try:
        yield
    finally:
        lab.run(BOB, "tc qdisc delete dev eth0 root")


def test_the_fleet_talks(lab):
    status, output = lab.play("playbooks/verify.yml")
    assert status == 0 and "PASSED" in output, output


def test_a_link_that_delays_is_no_fault(lab):
    """As by satellite: each packet of bob comes 0.3 s later."""
    with netem(lab, "delay 300ms"):
        assert "time=3" in lab.run(BOB, "ping -c 1 -W 5 192.168.20.21")
        status, output = lab.play("playbooks/verify.yml")
    assert status == 0 and "PASSED" in output and not LOSS.search(output), output


def test_a_link_that_loses_packets_is_named(lab):
    with netem(lab, "loss 30%"):
        output = lab.play("playbooks/verify.yml")[1]
    assert LOSS.search(output), output


def test_the_limits_of_all_units_are_those_of_the_kernel(lab):
    units = lab.run(BOB, "systemctl list-units --plain --no-legend --state running 'multimaster-*.service'").split()
    units = [word.partition(".")[0] for word in units if word.endswith(".service")]
    assert {UNIT, "multimaster-roscore", "multimaster-discovery", "multimaster-sync", "multimaster-connections"} <= {
        *units
    }
    for unit in units:
        text = lab.run(BOB, f"cat /etc/systemd/system/{unit}.service")
        (size, letter), (tasks,) = (
            re.search(r"^MemoryMax=(\d+)(\w)$", text, re.M).groups(),
            re.search(r"^TasksMax=(\d+)$", text, re.M).groups(),
        )
        assert read(lab, unit, "memory.max") == str(int(size) * SIZES[letter]), unit
        assert read(lab, unit, "pids.max") == tasks, unit


def test_a_unit_gets_no_more_tasks_than_its_limit(lab):
    most = int(read(lab, UNIT, "pids.max"))
    made = int(lab.run(BOB, inside(UNIT, "python3 /root/forks.py")))
    # Of 40. The program itself is one, too, the service another, and sometimes the service has a child.
    assert most - 3 <= made <= most - 2
    assert events(lab, UNIT, "pids.events", "max") >= 1
    assert lab.run(BOB, f"systemctl is-active {UNIT}") == "active\n"


def test_a_unit_gets_no_more_memory_than_its_limit(lab):
    """The kernel ends what takes too much, within the unit alone, and systemd starts the unit again."""
    most = int(read(lab, UNIT, "memory.max")) // MEBIBYTE
    others = running(lab)
    said = lab.run(BOB, inside(UNIT, f"python3 /root/eats.py {2 * most}"), check=False)
    assert str(2 * most) not in said
    wait_until(
        lambda: "Memory cgroup out of memory" in lab.run(BOB, "journalctl --boot --dmesg --no-pager"),
        60,
        "the kernel says so",
    )
    assert f"task_memcg=/system.slice/{UNIT}.service" in lab.run(BOB, "journalctl --boot --dmesg --no-pager")
    wait_until(
        lambda: lab.run(BOB, f"systemctl is-active {UNIT}", check=False) == "active\n", 60, "the unit runs again"
    )
    assert running(lab) == others
    # What stays below its limit runs to its end.
    assert lab.run(BOB, inside(UNIT, f"python3 /root/eats.py {most // 4}")) == f"{most // 4}\n"


def running(lab):
    """The processes of the units beside it, and how often they were started again."""
    names = "multimaster-roscore multimaster-discovery multimaster-sync multimaster-connections"
    return lab.run(BOB, f"systemctl show --property=MainPID,NRestarts {names}")
