# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""A hang is told from a wait for a processor: the rule over samples, and its reader."""

import os
import signal
import subprocess
import sys
import time

import pytest
from rosfleet_multimaster.edge.process.liveness import Limits, Sample, Silence, Thread, is_starved, read_sample

LIMITS = Limits(30.0, 20.0, 20.0)
NS = 1_000_000_000


def sample(at, *threads, spent=0.0, started="7"):
    """A process with these threads, each a state, seconds of a processor and seconds on the run queue."""
    found = {
        str(number): Thread(state, int(ran * NS), int(waited * NS))
        for number, (state, ran, waited) in enumerate(threads)
    }
    return Sample(at, started, spent, found)


def judged(*samples, age=60.0):
    silence = Silence(samples[0])
    for other in samples[1:]:
        silence.add(other)
    return silence.find_hang(age, LIMITS)


@pytest.mark.parametrize(
    ("before", "after", "starved"),
    [
        (("S", 1, 1), ("S", 1, 1), False),
        (("T", 1, 1), ("T", 1, 1), False),
        (("R", 1, 1), ("R", 1, 1), True),
        (("R", 1, 1), ("R", 1.1, 5.8), True),
        (("S", 1, 1), ("S", 1.05, 5), True),
        (("S", 1, 1), ("S", 1.01, 1.5), False),
        (("R", 1, 1), ("R", 6, 1.01), False),
        (("S", 1, 1), ("D", 1, 1), True),
        (("R", 0, 0), ("R", 0, 0), True),
        (("S", 0, 0), ("S", 0, 0), False),
    ],
    ids=[
        *(
            "asleep",
            "stopped",
            "waits since before",
            "waited and ran a little",
            "woken often, as for the interpreter's lock",
        ),
        *("wakes now and then", "computes", "waits for a disk", "a kernel that counts nothing", "asleep there"),
    ],
)
def test_a_process_waits_when_its_thread_got_no_processor(before, after, starved):
    assert is_starved(sample(0.0, before), sample(5.0, after)) is starved
    quiet = ("S", 3, 3)
    assert is_starved(sample(0.0, quiet, before), sample(5.0, quiet, after)) is starved, "one thread is enough"


def test_many_threads_wait_one_after_the_other():
    """A lock that goes round: each waits for a processor for a while, and the others for it."""
    assert is_starved(sample(0.0, *[("S", 0, 0)] * 5), sample(5.0, *[("S", 0, 0.8)] * 5))


IDLE = [sample(at, ("S", 1, 1), ("S", 2, 2)) for at in range(0, 60, 5)]


def test_a_process_without_any_wait_hangs_after_a_while():
    assert judged(*IDLE[:4]) == ""
    assert judged(*IDLE[:5]) == "it waits, and not for a processor or a disk"
    assert judged(*[sample(at, ("T", 1, 1)) for at in range(0, 21, 5)]) == "it is stopped"
    assert judged(*IDLE, age=29.0) == "", "it was heard of since"


def test_a_process_that_waited_has_its_time_anew():
    starved = [sample(at, ("S", 1, 1), ("R", 2, 2)) for at in range(0, 3600, 5)]
    assert judged(*starved) == "", "however long"
    then = [sample(3600 + one.at, ("T", 1, 1), ("T", 2, 2)) for one in IDLE]
    assert judged(*starved, *then[:3]) == ""
    assert judged(*starved, *then[:4]) == "it is stopped"


def test_a_process_that_computes_hangs_by_its_own_time():
    turns = [sample(at, ("R", at * 0.3, at * 0.7), spent=at * 0.3) for at in range(0, 65, 5)]
    assert judged(*turns) == "" and judged(*turns, sample(68, ("R", 21, 40), spent=21.0)) == (
        "it has computed for 21 s of a processor"
    )


def test_a_clock_that_jumps_ends_nothing():
    assert judged(sample(0.0, ("S", 1, 1)), sample(3000.0, ("S", 1, 1)), age=3000.0) == ""


def test_the_kernel_tells_of_a_process(tmp_path):
    program = "import threading, time\nfor n in range(3): threading.Thread(target=time.sleep, args=(60,), daemon=True).start()\ninput()"
    odd = tmp_path / "a ) R 1 (b"
    odd.symlink_to(sys.executable)
    with subprocess.Popen([str(odd), "-c", program], stdin=subprocess.PIPE) as process:
        try:
            until = time.monotonic() + 20
            while len((read_sample(process.pid) or sample(0.0)).threads) < 4:
                assert time.monotonic() < until
                time.sleep(0.05)
            before = read_sample(process.pid)
            assert before.threads[str(process.pid)].ran > 0 and before.spent >= 0
            os.kill(process.pid, signal.SIGSTOP)
            os.waitid(os.P_PID, process.pid, os.WSTOPPED | os.WNOWAIT)
            after = read_sample(process.pid)
            assert {thread.state for thread in after.threads.values()} == {"T"} and after.started == before.started
        finally:
            process.kill()
    assert read_sample(process.pid) is None, "it is gone"


def test_a_kernel_without_counters_has_states(tmp_path):
    here = tmp_path / "12"
    (here / "task/12").mkdir(parents=True)
    stat = "12 (x) S " + " ".join(str(number) for number in range(4, 53))
    for folder in (here, here / "task/12"):
        (folder / "stat").write_text(stat)
    found = read_sample(12, str(tmp_path))
    assert found.threads == {"12": Thread("S", 0, 0)} and found.started == "22"
    assert found.spent == pytest.approx((14 + 15) / os.sysconf("SC_CLK_TCK"))
