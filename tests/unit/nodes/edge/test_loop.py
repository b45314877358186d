# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The loop with real threads."""

import socket
import threading
import time

import pytest
from rosfleet_multimaster.edge.loop import DirectRunner, Loop, RecurringJob, Workers


def test_the_loop_runs_what_workers_and_threads_hand_it():
    loop, seen = Loop(), []
    workers = Workers(loop, 2)

    def note(what):
        seen.append(what)
        if len(seen) == 2:  # either worker may be the later one
            loop.stop()

    workers.submit(lambda: 6 * 7, lambda result, problem: note((result, problem, threading.current_thread())))
    workers.submit(lambda: 1 / 0, lambda result, problem: note(type(problem)))
    loop.run(lambda now: now + 5.0)
    assert (42, None, threading.main_thread()) in seen and ZeroDivisionError in seen


def test_a_loop_that_is_awake_is_not_woken_again():
    loop, said, seen = Loop(), [], []

    class Counts:
        def send(self, data):
            said.append(data)
            return real.send(data)

    real, loop._waker = loop._waker, Counts()
    for number in range(100):
        loop.post(seen.append, number)
    assert len(said) == 1
    loop.post(lambda: loop.post(loop.stop))  # what is put in while the others run wakes it for one more pass
    loop.run(lambda now: now + 30.0)
    assert seen == list(range(100)) and len(said) <= 3


def test_no_call_of_many_threads_is_left_in_a_loop_that_sleeps():
    loop, seen = Loop(), []
    counted = threading.Thread(target=loop.run, args=(lambda now: now + 30.0,), daemon=True)
    counted.start()
    callers = [threading.Thread(target=lambda: [loop.post(seen.append, 1) for _n in range(500)]) for _t in range(8)]
    began = time.monotonic()
    for caller in callers:
        caller.start()
    for caller in callers:
        caller.join()
    loop.post(loop.stop)
    counted.join(20)
    assert len(seen) == 4000 and time.monotonic() - began < 20, "a call that nobody woke it for"


def test_what_is_posted_for_later_comes_in_its_order():
    loop, seen, began = Loop(), [], time.monotonic()
    loop.post_later(0.2, loop.stop)
    loop.post_later(0.1, lambda: seen.append("second"))
    loop.post_later(0.0, lambda: seen.append("first"))
    loop.run(lambda now: now + 30.0)
    assert seen == ["first", "second"] and 0.2 <= time.monotonic() - began < 20
    threading.Timer(0.1, loop.post_later, (0.1, loop.stop)).start()
    loop._running = True
    loop.run(lambda now: now + 30.0)
    assert time.monotonic() - began < 20, "nobody woke it"


def test_what_is_posted_for_later_may_change_what_is_due():
    loop, due, began = Loop(), [float("inf")], time.monotonic()
    loop.post_later(0.1, lambda: due.__setitem__(0, 0.0))
    threading.Timer(5.0, loop.stop).start()

    def tick(now):
        if now >= due[0]:
            loop.stop()
        return due[0]

    loop.run(lambda now: min(tick(now), now + 30.0))
    assert time.monotonic() - began < 4, "it has slept over it"


def test_a_recurring_job_has_one_run_at_a_time():
    done = []

    class Later:
        def submit(self, job, ended):
            done.append(lambda: ended(job(), None))

    results, wanted = [], [True]
    job = RecurringJob(
        Later(), lambda: 5.0, lambda: 42, lambda result, problem: results.append(result), lambda: wanted[0]
    )
    assert job.tick(10.0) is None and job.tick(20.0) is None and len(done) == 1, "it runs"
    done.pop()()
    assert results == [42] and job.tick(12.0) == 15.0 and not done
    job.due = 11.0
    assert job.tick(12.0) is None and len(done) == 1
    done.pop()()
    wanted[0] = False
    assert job.tick(99.0) is None and not done, "there is nothing to run for"


def test_overlapping_runs_start_while_an_earlier_one_hangs():
    started = []

    class Hangs:
        def submit(self, job, ended):
            started.append(job)

    job = RecurringJob(Hangs(), lambda: 5.0, lambda: 42, overlapping=True)
    assert job.tick(10.0) == 15.0 and job.tick(12.0) == 15.0 and job.tick(15.0) == 20.0 and len(started) == 2


def test_a_recurring_job_in_the_loop_has_ended_when_it_returns():
    seen = []
    job = RecurringJob(DirectRunner(), lambda: 1.0, lambda: seen.append(1))
    assert job.tick(7.0) == 8.0 and job.tick(7.5) == 8.0 and job.tick(8.0) == 9.0 and len(seen) == 2


@pytest.fixture(name="systemd")
def _systemd(tmp_path, monkeypatch):
    """The messages to systemd of this process, which is to say each 0.4 s that it turns."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listening:
        listening.bind(str(tmp_path / "notify"))
        listening.settimeout(5.0)
        monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "notify"))
        monkeypatch.setenv("WATCHDOG_USEC", "400000")
        monkeypatch.delenv("WATCHDOG_PID", raising=False)
        yield listening


def test_a_loop_that_has_nothing_to_do_feeds_the_watchdog(systemd):
    loop = Loop()
    turning = threading.Thread(target=loop.run, args=(lambda now: now + 60.0,))
    began = time.monotonic()  # before the first word, which this thread may see late
    turning.start()
    assert [systemd.recv(100) for _count in range(8)] == [b"WATCHDOG=1"] * 8
    assert 0.6 < time.monotonic() - began < 4.0, "each 0.1 s, and not at each pass"
    loop.stop()
    turning.join(5.0)


def test_a_loop_that_hangs_feeds_nothing_whatever_its_workers_do(systemd):
    loop, hangs, free = Loop(), threading.Event(), threading.Event()
    workers = Workers(loop, 2)
    turning = threading.Thread(target=loop.run, args=(lambda now: now + 0.01,))
    turning.start()
    systemd.recv(100)
    loop.post(lambda: (hangs.set(), free.wait(10.0)))
    assert hangs.wait(10.0), "what it says from now on is no word from before"
    systemd.setblocking(False)
    while True:
        try:
            systemd.recv(100)
        except BlockingIOError:
            break
    for _count in range(5):
        workers.submit(lambda: 1, lambda result, problem: None)
        time.sleep(0.1)
    with pytest.raises(BlockingIOError):
        systemd.recv(100)
    free.set()
    systemd.settimeout(5.0)
    assert systemd.recv(100) == b"WATCHDOG=1"
    loop.stop()
    turning.join(5.0)
