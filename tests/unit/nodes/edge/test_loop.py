# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The loop with real threads."""

import threading

from rosfleet_multimaster.edge.loop import Loop, Workers


def test_the_loop_runs_what_workers_and_threads_hand_it():
    loop, seen = Loop(), []
    workers = Workers(loop, 2)
    workers.submit(lambda: 6 * 7, lambda result, problem: seen.append((result, problem, threading.current_thread())))
    workers.submit(lambda: 1 / 0, lambda result, problem: (seen.append(type(problem)), loop.post(loop.stop)))
    loop.run(lambda now: now + 5.0)
    assert (42, None, threading.main_thread()) in seen and ZeroDivisionError in seen
