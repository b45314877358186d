# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Services that hang are ended, and one that waits for a processor is not: with processes of this computer."""

import os
import signal
import subprocess
import sys
import time

import pytest
from rosfleet_multimaster.edge.process.liveness import Limits, read_sample
from rosfleet_multimaster.end_hangs import Judge, Service, read_services

pytestmark = pytest.mark.whole

SHOWN = """\
Id=multimaster-roscore.service
ActiveState=active
MainPID=812
WatchdogUSec=30min
WatchdogTimestampMonotonic=72500000
ActiveEnterTimestampMonotonic=12000000

Id=multimaster-sync.service
ActiveState=active
MainPID=813
WatchdogUSec=30min
WatchdogTimestampMonotonic=0
ActiveEnterTimestampMonotonic=12000000

"""


def test_services_that_give_signs_of_life_are_judged():
    assert read_services(SHOWN) == {
        "multimaster-roscore.service": Service(812, 72.5),
        "multimaster-sync.service": Service(813, 12.0),
    }


@pytest.mark.parametrize(
    ("line", "other"),
    [
        ("ActiveState=active", "ActiveState=activating"),
        ("ActiveState=active", "ActiveState=deactivating"),
        ("WatchdogUSec=30min", "WatchdogUSec=0"),
        ("WatchdogUSec=30min", "WatchdogUSec=infinity"),
        ("MainPID=812", "MainPID=0"),
        ("MainPID=812", "MainPID=1"),
        ("MainPID=812", "MainPID="),
        ("MainPID=812\n", ""),
        ("Id=multimaster-roscore.service\n", ""),
    ],
)
def test_others_are_not_judged(line, other):
    assert list(read_services(SHOWN.replace(line, other, 1))) == ["multimaster-sync.service"]
    assert read_services("") == {}


STOPPED = "import os, signal; os.kill(os.getpid(), signal.SIGSTOP)"
BLOCKED = "import threading; lock = threading.Lock(); lock.acquire(); print('begins', flush=True); lock.acquire()"
SPINNING = "import re; print('begins', flush=True); re.match('(a+)+b', 'a' * 64)"
DEAF = (
    "import os, signal; signal.signal(signal.SIGABRT, signal.SIG_IGN)\nwhile True: os.kill(os.getpid(), signal.SIGSTOP)"
)
# It wants half a second of a processor for each turn, and the kernel gives it next to nothing of the one that is taken.
STARVED = """
import os, time
os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))
print('begins', flush=True)
while True:
    until = time.process_time() + 0.5
    while time.process_time() < until:
        pass
    print('turns', flush=True)
"""
HOG = "import os\nos.sched_setaffinity(0, {min(os.sched_getaffinity(0))})\nwhile True: pass"


@pytest.fixture(name="start")
def _start():
    running = []

    def start(program):
        running.append(
            subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
        )
        return running[-1]

    yield start
    for process in running:
        process.kill()
        process.wait(10)
        process.stdout.close()


def look_until(judge, services, ended, seconds=60.0):
    """Look each 0.2 s until these processes have ended, or for this time."""
    until = time.monotonic() + seconds
    while time.monotonic() < until and (not ended or any(process.poll() is None for process in ended)):
        judge.look({name: service for name, (process, service) in services.items() if process.poll() is None})
        time.sleep(0.2)


@pytest.mark.parametrize("program", [STOPPED, BLOCKED, SPINNING], ids=["stopped", "blocked", "computing"])
def test_a_process_that_hangs_is_ended(start, program, capfd):
    process = start(program)
    silent = Service(process.pid, time.monotonic())
    look_until(Judge(Limits(1.0, 1.0, 1.0), 0.5, 30.0), {"multimaster-sync.service": (process, silent)}, [process])
    assert process.returncode == -signal.SIGABRT, "so it writes where it hangs"
    said = capfd.readouterr().err
    assert said.count("multimaster-sync.service hangs, and is ended") == 1, said


def test_a_process_that_does_not_hear_is_killed(start):
    process = start(DEAF)
    silent = Service(process.pid, time.monotonic())
    look_until(Judge(Limits(1.0, 1.0, 1.0), 0.5, 1.0), {"multimaster-sync.service": (process, silent)}, [process])
    assert process.returncode == -signal.SIGKILL


def test_a_process_that_is_heard_of_lives(start):
    process = start(STOPPED)
    judge, until = Judge(Limits(0.6, 1.0, 0.6), 0.3, 1.0), time.monotonic() + 3.0
    while time.monotonic() < until:
        judge.look({"multimaster-sync.service": Service(process.pid, time.monotonic())})
        time.sleep(0.1)
    assert process.poll() is None


def test_a_process_that_waits_lives_beside_one_that_hangs(start):
    starved = start(STARVED)
    assert starved.stdout.readline() == b"begins\n"
    hogs = [start(HOG) for _number in range(4)]
    began = time.monotonic()
    while not all(read_sample(hog.pid).spent > 0.1 for hog in hogs):
        assert time.monotonic() < began + 60
        time.sleep(0.1)
    os.set_blocking(starved.stdout.fileno(), False)
    starved.stdout.read()
    judge, silent = Judge(Limits(2.0, 20.0, 2.0), 0.5, 2.0), time.monotonic()
    waits = {"multimaster-roscore.service": (starved, Service(starved.pid, silent))}
    look_until(judge, waits, [], 10.0)
    assert starved.poll() is None
    turns = starved.stdout.read() or b""
    assert len(turns.splitlines()) <= 1, "it was starved: in this time it turns twenty times"
    stopped = start(STOPPED)
    both = {**waits, "multimaster-sync.service": (stopped, Service(stopped.pid, time.monotonic()))}
    look_until(judge, both, [stopped])
    assert stopped.poll() == -signal.SIGABRT and starved.poll() is None
    starved.send_signal(signal.SIGSTOP)  # and it is ended when it hangs, too
    look_until(judge, waits, [starved])
    assert starved.poll() == -signal.SIGABRT
