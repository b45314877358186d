# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The sandbox of the running services, and the watchdog of the nodes."""

import shlex
import time

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine import unit_ends

FIRST, SECOND = "kobuki1computer", "kobuki2computer"
#: service -> the worst rating that it may have, and its capabilities: one has CAP_NET_ADMIN
SERVICES = {
    "roscore": (1.5, 0),
    "discovery": (1.5, 0),
    "connections": (2.0, 1 << 12),
    "sync": (2.0, 0),
}
NODES = ("discovery", "connections", "sync")


@pytest.mark.parametrize("name", SERVICES)
@pytest.mark.parametrize("host", [FIRST, SECOND])
def test_running_services_are_in_their_sandbox(lab, host, name):
    worst, capabilities = SERVICES[name]
    unit = f"multimaster-{name}.service"
    said = lab.run(host, f"systemd-analyze security --no-pager {unit} | tail -n 1")
    rating = float(said.partition(": ")[2].split()[0])
    print(f"\n{host}, {unit}: {rating}")
    assert rating <= worst
    lines = lab.run(host, f"cat /proc/$(systemctl show --value -p MainPID {unit})/status").splitlines()
    status = dict(line.split(":\t", 1) for line in lines if ":\t" in line)
    assert (status["NoNewPrivs"], status["Seccomp"]) == ("1", "2")
    assert int(status["CapBnd"], 16) == int(status["CapEff"], 16) == capabilities
    assert "0" not in status["Uid"].split()


@pytest.fixture(scope="module")
def watched(lab):
    """A topic that crosses from the second robot to the first."""
    lab.start(SECOND, "watched", "rostopic pub -r 5 /watched std_msgs/String here")
    yield lab
    lab.stop(SECOND, "watched")


def test_the_watchdog_has_one_right_of_root(lab):
    lines = lab.run(FIRST, "cat /proc/$(systemctl show --value -p MainPID multimaster-watchdog)/status").splitlines()
    status = dict(line.split(":\t", 1) for line in lines if ":\t" in line)
    assert int(status["CapBnd"], 16) == int(status["CapEff"], 16) == 1 << 5, "CAP_KILL"
    assert (status["NoNewPrivs"], status["Seccomp"]) == ("1", "2")


def test_what_hangs_is_started_again_within_a_minute(watched):
    """All at once: stopped, and the roscore frozen with all that it has started."""
    lab, units = watched, [f"multimaster-{node}.service" for node in ("roscore", *NODES)]
    show = f"systemctl show -p MainPID -p NRestarts -p ActiveState --value {' '.join(units)}"
    before = [block.split() for block in lab.run(FIRST, show).split("\n\n")]
    assert [restarts for _pid, restarts, _state in before] == ["0"] * len(units)
    began = time.monotonic()
    lab.run(FIRST, f"systemctl kill --signal STOP {units[0]}; kill -STOP {' '.join(pid for pid, *_more in before[1:])}")
    waiting = dict(zip(units, before, strict=True))
    while waiting:
        now = [block.split() for block in lab.run(FIRST, show).split("\n\n")]
        for unit, (pid, _restarts, state) in zip(units, now, strict=True):
            if unit in waiting and pid != waiting[unit][0] and state == "active":
                del waiting[unit]
                print(f"\n{unit} is there again after {time.monotonic() - began:.1f} s")
        assert time.monotonic() - began < 60, waiting
        time.sleep(0.3)
    said = lab.run(FIRST, "journalctl --unit multimaster-watchdog.service --output cat --lines 100")
    for unit in units:
        assert f"{unit} hangs, and is ended: no sign of life for " in said and "it is stopped" in said
        if "connections" not in unit:
            told = lab.run(FIRST, f"journalctl --unit {unit} --output cat --lines 2000")
            assert "Fatal Python error: Aborted" in told and "most recent call first" in told, "it says where it hung"
    ended = unit_ends.read_ends(lab.run(FIRST, shlex.join(unit_ends.list_words(units))).splitlines(), units)
    assert {unit: end.result for unit, end in ended.items()} == dict.fromkeys(units, "watchdog")
    # SIGABRT; SIGSEGV if Python met a thread that ran on while it wrote down where each thread was
    assert {end.status for end in ended.values()} <= {6, 11}
    masters = (
        "timeout 20 bash -c 'until rosservice call /master_discovery/list_masters | grep -q %s; do sleep 0.2; done'"
    )
    lab.run(FIRST, masters % SECOND)
    lab.run(SECOND, masters % FIRST)
    assert "here" in lab.run(FIRST, "timeout -k 5 30 rostopic echo -n 1 /watched")


ASK = """
import json, os, socket, sys
sys.path.insert(0, "/usr/local/lib/rosfleet-multimaster/python")
from rosfleet_multimaster.edge import connections
from rosfleet_multimaster.sync import connection_ender
if sys.argv[1] != "root":
    os.setgroups([])
    os.setgid(int(sys.argv[1]))
    os.setuid(int(sys.argv[2]))
try:
    print(len(connection_ender.end(lambda found: True)))
except OSError as problem:
    print(problem)
"""


def test_only_sync_may_have_connections_ended(lab):
    lab.start(SECOND, "told", "rostopic pub -r 5 /told std_msgs/String here")
    lab.start(FIRST, "hears", "rostopic echo /told")
    lab.run(FIRST, "timeout 30 bash -c 'until grep -q here /run/hears.out; do sleep 0.2; done'")
    lab.run(FIRST, "cat > /tmp/ask.py", stdin=ASK)
    look = "ss -Htn state established | grep -E ':(11311|11611|22)[[:space:]]' | awk '{print $3, $4}'"  # both ends
    user, group = lab.run(FIRST, "stat -c '%u %g' /proc/$(systemctl show --value -p MainPID multimaster-sync)").split()
    for who in ("root", "65534 65534", f"65534 {user}"):  # sync's user alone is not enough
        assert not lab.run(FIRST, f"python3 /tmp/ask.py {who}").strip().isdigit(), who
    before = set(lab.run(FIRST, look).splitlines())
    time.sleep(1)
    before &= set(lab.run(FIRST, look).splitlines())  # without those of a question, which end by themselves
    assert before
    said = lab.run(FIRST, f"python3 /tmp/ask.py {group} {user}").strip()
    print(f"\nended of all connections of the computer: {said}; roscore, discovery and ssh have {len(before)}")
    assert said.isdigit() and int(said) > 0, "those with nodes of the fleet"
    assert len(lab.run(FIRST, look).splitlines()) >= len(before) - 1  # one may have come to its end by itself
    lab.stop(FIRST, "hears")
    lab.stop(SECOND, "told")
