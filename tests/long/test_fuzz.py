# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""A million datagrams and ten thousand requests that nobody should send, against the running nodes: nothing changes.

The second robot sends them, to the first: random ones, mutated ones, valid ones in the name of others. All of it stays in
the lab's internal network. FUZZ_SEED, FUZZ_DATAGRAMS and FUZZ_REQUESTS choose another seed, and less of it.
"""

import contextlib
import json
import os
import random
import re
import subprocess
import time
from pathlib import Path

import pytest
from machines import containers
from setups.links import Watch, wait_until
from subject import lab_of

HERE = Path(__file__).parent
ROOT = HERE.parents[1]

LAB = os.environ.get("FUZZ_LAB", "long-fuzz")
VICTIM, PEER = "kobuki1computer", "kobuki2computer"
ADDRESSES, GROUP = ("192.168.1.229", "192.168.1.239"), "224.0.0.1"
SEED = os.environ.get("FUZZ_SEED", str(random.randrange(10**6)))
DATAGRAMS = int(os.environ.get("FUZZ_DATAGRAMS", "1000000"))
REQUESTS = int(os.environ.get("FUZZ_REQUESTS", "10000"))
RATE = 12000  # datagrams a second
UNITS = ("multimaster-roscore", "multimaster-discovery", "multimaster-sync")
NODES = UNITS[1:]
GROWTH = 60_000  # kB that a node may be larger afterwards
PEAK = 250_000  # kB that a node may have at any time
LINES = 100  # log lines of a node during one attack
CROSSES = 10.0  # seconds in which a topic that is made during an attack has crossed
SILENCE = 4.0  # seconds without a heartbeat; the others wait 4.5 (measured: one, and 3.1 once in a flood of strangers)


@pytest.fixture(scope="module")
def lab():
    print(f"\nFUZZ_SEED={SEED}")
    with lab_of(LAB, ROOT / "inventory" / "single_computer") as found:
        status, output = found.play("site.yml")
        assert status == 0, output
        found.start(PEER, "before", "rostopic pub -r 5 /fuzz/before std_msgs/Int32 1")
        wait_until(lambda: "/fuzz/before" in roscore(found), 20, "the other robot's topic")
        found.run(
            PEER, "cat > /tmp/hostile_inputs.py", stdin=(ROOT / "lab/nodes/hostile/hostile_inputs.py").read_text()
        )
        yield found


@pytest.fixture(scope="module")
def watch(lab):
    return Watch(lab, VICTIM, 10)


def roscore(lab):
    """The registrations of the first robot's roscore."""
    ask = "import xmlrpc.client as x; print(x.ServerProxy('http://localhost:11311').getSystemState('/look')[2])"
    return lab.run(VICTIM, f'python3 -c "{ask}"')


def masters(lab):
    """(name, online) of list_masters."""
    listed = lab.run(VICTIM, "rosservice call /master_discovery/list_masters", check=False)
    return sorted(zip(re.findall(r'name: "?(kobuki\w+)', listed), re.findall(r"online: (\w+)", listed)))


MASTERS = [(VICTIM, "True"), (PEER, "True")]


def processes(lab):
    """Of each unit: process, restarts."""
    return lab.run(VICTIM, f"systemctl show --property MainPID,NRestarts {' '.join(UNITS)}")


def sizes(lab):
    """Of each node: memory and its peak in kB, threads, seconds of CPU, log lines."""
    found = {}
    for unit in NODES:
        text = lab.run(
            VICTIM,
            f"pid=$(systemctl show --value --property MainPID {unit}); cat /proc/$pid/status; cut -d' ' -f14,15 /proc/$pid/stat;"
            f" journalctl --quiet --output cat --unit {unit} | wc -l",
        )
        user, system, lines = map(int, text.split()[-3:])
        values = {key: int(re.search(rf"{key}:\s+(\d+)", text)[1]) for key in ("VmRSS", "VmHWM", "Threads")}
        found[unit] = {**values, "cpu": (user + system) / 100, "lines": lines}
    return found


@contextlib.contextmanager
def unchanged(lab, name):
    """Both nodes are the same processes, have not grown, and know and hold the same afterwards."""
    wait_until(lambda: masters(lab) == MASTERS, 30, "both masters before")
    before, state, small = processes(lab), roscore(lab), sizes(lab)
    yield
    assert processes(lab) == before
    wait_until(lambda: masters(lab) == MASTERS, 30, "both masters afterwards")
    wait_until(lambda: roscore(lab) == state, 30, "the same state of the roscore")
    wait_until(
        lambda: all(sizes(lab)[unit]["Threads"] <= small[unit]["Threads"] for unit in NODES), 40, "no more threads"
    )
    large = sizes(lab)
    for unit in NODES:
        print(f"{name}: {unit}:", {key: (small[unit][key], large[unit][key]) for key in small[unit]})
        assert large[unit]["VmRSS"] - small[unit]["VmRSS"] < GROWTH
        assert large[unit]["VmHWM"] < PEAK
        assert large[unit]["lines"] - small[unit]["lines"] < LINES
    assert processes(lab) == before


def attack(script, *arguments):
    """Start one of the scripts on the second robot."""
    container = ["--env", "PYTHONPATH=/tmp", containers.container(LAB, PEER)]
    words = ["podman", "exec", "-i", *container, "python3", "-", *map(str, arguments)]
    with open(HERE / script, encoding="utf-8") as program:
        return subprocess.Popen(words, stdin=program, stdout=subprocess.PIPE, text=True)


def result(name, running):
    """The counts of a script."""
    output, _errors = running.communicate(timeout=1800)  # a robot that asks much is slowed down
    print(f"{name}:", output.strip())
    assert running.returncode == 0
    return json.loads(output)


def meanwhile(lab, watch, running, name):
    """Check the services that must work during an attack: the list of masters, and a new topic of the other robot."""
    time.sleep(3)
    topic = f"/fuzz/{name}"
    lab.start(PEER, name, f"rostopic pub -r 1 {topic} std_msgs/Int32 1")
    lab.run(
        PEER,
        f"until rosnode list | grep -q rostopic; do sleep 0.1; done; until rostopic list | grep -q {topic}; do sleep 0.1; done",
    )
    started = time.monotonic()
    wait_until(
        lambda: any(f"+ publisher {topic} " in text for _at, text in watch.events()), CROSSES, f"{topic} crosses"
    )
    assert running.poll() is None, "the attack is still going on"
    print(f"{name}: {topic} has crossed after {time.monotonic() - started:.1f} s")
    wait_until(lambda: masters(lab) == MASTERS, 15, "both masters during the attack")
    lab.stop(PEER, name)


@pytest.mark.parametrize("kind", ["random", "mutated", "spoofed", "strangers"])
def test_a_million_datagrams_change_nothing(lab, watch, kind):
    with unchanged(lab, kind):
        counters = udp(lab)
        running = attack("fuzz_datagrams.py", *ADDRESSES, GROUP, SEED, DATAGRAMS // 4, RATE, kind)
        meanwhile(lab, watch, running, kind)
        found = result(kind, running)
        print(
            f"{kind}: {found['sent'] / found['seconds']:.0f} datagrams a second; read, lost:",
            [a - b for a, b in zip(udp(lab), counters)],
        )
        assert found["sent"] >= DATAGRAMS // 4 * 0.99
        assert found["longest gap"] < SILENCE


def udp(lab):
    """The first robot's datagrams that were read, and that found no room in the socket."""
    words = lab.run(VICTIM, "grep ^Udp: /proc/net/snmp | tail -1").split()
    return int(words[1]), int(words[5])


@pytest.mark.parametrize("kind", ["leave of a stranger", "leave of the peer"])
def test_a_thousand_spoofed_leaves_in_30_seconds_remove_no_robot(lab, watch, kind):
    with unchanged(lab, kind):
        started, since = time.monotonic(), time.time()
        running = attack("fuzz_datagrams.py", *ADDRESSES, GROUP, SEED, 1000, 1000 / 30, kind)
        assert result(kind, running)["longest gap"] < SILENCE
        time.sleep(5)
        lost = [text for _at, text in watch.events(started) if text.startswith("- ") and "/fuzz/before" in text]
        assert lost == [], "the registrations of the master that is alive stay"
        said = lab.run(VICTIM, f"journalctl --quiet --output cat --since @{since:.0f} --unit {NODES[0]}")
        print(f"{kind}:", said.splitlines())
        assert "is gone" not in said


def test_ten_thousand_requests_change_nothing(lab, watch):
    with unchanged(lab, "requests"):
        running = attack("fuzz_requests.py", ADDRESSES[0], SEED, REQUESTS)
        meanwhile(lab, watch, running, "requests")
        found = result("requests", running)
        assert found["sent"] == REQUESTS
        assert set(found["answers"]) <= {"200", "400", "404", "501", "414", "505", "fault", "nothing"}, (
            "every one had its answer"
        )
        assert found["slowest"] < 20
