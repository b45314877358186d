# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Calls with a limit in time, from several threads, and questions at a pace."""

import threading

import pytest
from rosfleet_multimaster.edge import patience
from rosfleet_multimaster.edge.patience import BURST, Pace


class SlowThread(threading.Thread):
    """A call that has ended. The first caller that looks at it is held up until `go`, or for half a second."""

    def __init__(self):
        super().__init__()
        self.seen, self.go = threading.Event(), threading.Event()

    def is_alive(self):
        if not self.seen.is_set():
            self.seen.set()
            self.go.wait(0.5)
        return False


def test_a_call_that_hangs_is_counted_when_two_look_at_once(monkeypatch):
    end, slow = threading.Event(), SlowThread()
    hung = threading.Thread(target=end.wait, daemon=True)
    hung.start()
    monkeypatch.setattr(patience, "_hanging", [slow, hung])
    caller = threading.Thread(target=patience.run_with_limit, args=(5.0, str))
    caller.start()
    assert slow.seen.wait(5.0)
    assert patience.run_with_limit(5.0, lambda: "answer") == "answer"
    slow.go.set()
    caller.join()
    assert patience._hanging == [hung]
    end.set()


def test_whoever_streams_changes_has_so_many_a_second():
    """An answer comes at once, whatever is asked; each one has news."""
    for whole, most in ((False, BURST + 10 * 20.0), (True, 1 + 10 * 1.0 + 1)):
        pace, now, answers = Pace(), 100.0, 0
        while now < 110.0:
            now = pace.next(now, 0.0, whole, False) + 0.0001
            answers += 1
        assert answers <= most + 1


def test_costly_masters_are_asked_less():
    assert Pace().next(100.0, 0.5, False, False) == 102.0
    assert Pace().next(100.0, 0.0, False, True) == 101.0
    assert Pace().next(100.0, 0.001, False, False) == pytest.approx(100.004)
