# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The sandbox of the running services, and the watchdog of the nodes."""

import time

import pytest

FIRST, SECOND = "kobuki1computer", "kobuki2computer"
#: service -> the worst rating that it may have, and its capabilities: one has CAP_NET_ADMIN
SERVICES = {
    "roscore": (1.5, 0),
    "discovery": (1.5, 0),
    "connections": (2.0, 1 << 12),
    "sync": (2.0, 0),
}
NODES = ("discovery", "connections", "sync")
WATCHDOG = 4  # seconds, in this test


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
def impatient(lab):
    """The nodes of the first robot with a watchdog of a few seconds."""
    folders = " ".join(f"/run/systemd/system/multimaster-{node}.service.d" for node in NODES)
    restart = f"systemctl daemon-reload && systemctl restart {' '.join(f'multimaster-{node}' for node in NODES)}"
    lab.run(
        FIRST,
        f"for folder in {folders}; do mkdir -p $folder; printf '[Service]\\nWatchdogSec={WATCHDOG}\\n' > $folder/test.conf; done; {restart}",
    )
    lab.start(SECOND, "watched", "rostopic pub -r 5 /watched std_msgs/String here")
    yield lab
    lab.stop(SECOND, "watched")
    lab.run(FIRST, f"rm -r {folders}; {restart}")


@pytest.mark.parametrize("node", NODES)
def test_a_node_that_hangs_is_started_again(impatient, node):
    lab, unit = impatient, f"multimaster-{node}.service"
    show = f"systemctl show -p MainPID -p NRestarts -p ActiveState --value {unit}"
    pid, restarts, _state = lab.run(FIRST, show).split()
    assert restarts == "0"
    began = time.monotonic()
    lab.run(FIRST, f"kill -STOP {pid}")
    while (now := lab.run(FIRST, show).split())[1] == "0" or now[2] != "active":
        assert time.monotonic() - began < 60, now
        time.sleep(0.3)
    print(f"\n{unit} is there again after {time.monotonic() - began:.1f} s")
    assert now[:2] == [lab.run(FIRST, f"systemctl show -p MainPID --value {unit}").strip(), "1"] and now[0] != pid
    said = lab.run(FIRST, f"journalctl --unit {unit} --output cat --lines 2000")
    assert "Watchdog timeout" in said
    if node != "connections":
        assert "Fatal Python error: Aborted" in said and "most recent call first" in said, "it says where it hung"
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
