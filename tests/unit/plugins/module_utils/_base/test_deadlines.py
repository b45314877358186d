# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Waiting with a limit, which knows how slow or busy a machine is."""

import os
import socket
import subprocess
import sys
import time

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._base import deadlines
from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine import outcomes
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.ros_client import xml_rpc


@pytest.mark.slow
def test_concurrently_keeps_the_order_and_leaves_the_late_behind():
    began = time.monotonic()
    results = deadlines.call_all(lambda item: time.sleep(item) or item, [0.2, 0, 60, 0.1], 2.0, lambda item: "late")
    assert results == [0.2, 0, "late", 0.1]
    assert time.monotonic() - began < 30


def test_concurrently_does_not_hide_a_mistake():
    with pytest.raises(ZeroDivisionError):
        deadlines.call_all(lambda item: 1 / item, [1, 0], 1, str)


def test_awaited_ends_as_soon_as_it_may_and_at_the_deadline():
    seen = iter([1, 2, 3])
    assert deadlines.poll(lambda: next(seen), lambda value: value == 2, time.monotonic() + 10) == 2
    assert deadlines.poll(lambda: "no", lambda value: False, time.monotonic()) == "no"


SECOND = 10**9


@pytest.fixture(autouse=True)
def _usual(monkeypatch):
    monkeypatch.setattr(deadlines, "_measured", [1.0])


@pytest.mark.parametrize(
    ("told", "least", "most"),
    [
        (f"{SECOND} 0 7", 1.0, 6.0),
        (f"{SECOND} {2 * SECOND} 7", 3.0, 6.0),
        (f"{SECOND} {90 * SECOND} 7", 6.0, 6.0),
        ("0 0 0", 1.0, 6.0),
        ("", 1.0, 6.0),
        ("nothing", 1.0, 6.0),
    ],
)
def test_who_waits_for_a_processor_has_another_pace(tmp_path, told, least, most):
    (tmp_path / "schedstat").write_text(told)
    assert least <= deadlines.measure_pace(str(tmp_path / "schedstat")) <= most


def test_a_slow_processor_has_another_pace_and_is_not_busy(monkeypatch, tmp_path):
    (tmp_path / "schedstat").write_text("100 50 1")
    for path, pace, busy in (("/nothing", 3.0, 1.0), (str(tmp_path / "schedstat"), 4.5, 1.5)):
        times = iter([0.0, 3 * deadlines.USUAL])
        monkeypatch.setattr(deadlines.time, "process_time", lambda times=times: next(times))
        assert deadlines.measure_pace(path) == busy and deadlines.stretch(2.0) == pytest.approx(2.0 * pace)


def test_a_limit_is_stretched_within_bounds(monkeypatch):
    assert deadlines.stretch(5.0) == 5.0
    monkeypatch.setattr(deadlines, "_measured", [4.0])
    assert (deadlines.stretch(5.0), deadlines.stretch(900.0)) == (20.0, 900.0 + deadlines.LONGEST)


@pytest.mark.slow
def test_an_answer_that_is_late_is_waited_for_on_a_busy_machine(monkeypatch):
    monkeypatch.setattr(xml_rpc, "CALL", 0.4)
    with socket.create_server(("127.0.0.1", 0)) as silent:
        uri = f"http://127.0.0.1:{silent.getsockname()[1]}/"

        def ask():
            began = time.monotonic()
            with pytest.raises(TimeoutError):
                xml_rpc.server(uri).anything()
            return time.monotonic() - began

        assert ask() >= 0.4
        monkeypatch.setattr(deadlines, "_measured", [3.0])
        assert ask() >= 1.2
    assert deadlines.call_all(lambda _item: time.sleep(0.8) or "heard", [1], 0.4, lambda _item: "late") == ["heard"]
    given = []
    monkeypatch.setattr(
        outcomes.socket, "create_connection", lambda _place, timeout: given.append(timeout) or socket.socket()
    )
    outcomes.connect("127.0.0.1", 9, 2.0)
    assert given == [6.0]


@pytest.mark.slow
@pytest.mark.skipif(not os.path.exists("/proc/self/schedstat"), reason="this kernel does not count it")
def test_a_busy_processor_is_seen():
    """Several programs on one processor: the kernel has each of them wait."""
    processor = min(os.sched_getaffinity(0))
    spin = f"import os; os.sched_setaffinity(0, [{processor}])\nwhile True: pass"
    look = f"import os; os.sched_setaffinity(0, [{processor}])\nfor _n in range(10**7): pass\nprint(open('/proc/self/schedstat').read())"
    busy = [subprocess.Popen([sys.executable, "-c", spin]) for _number in range(4)]
    try:
        told = subprocess.run([sys.executable, "-c", look], capture_output=True, text=True, check=True).stdout
    finally:
        for process in busy:
            process.kill()
            process.wait()
    ran, waited = map(int, told.split()[:2])
    assert waited > ran
