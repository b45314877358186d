# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Calls with a limit in time, from several threads."""

import threading

from rosfleet_multimaster.edge import patience


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
