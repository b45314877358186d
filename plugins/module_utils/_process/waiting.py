# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""Waiting with a limit: many questions at the same time, and looks that are repeated until a deadline."""

import queue
import threading
import time
import typing

WORKERS = 16


PAUSE = 0.5  # seconds between two looks at something that is awaited


def concurrently(
    function: typing.Callable, items: typing.Sequence, limit: float, late: typing.Callable, workers: int = WORKERS
) -> typing.List:
    """Call a function for each item, in several threads; late(item) replaces a result that is not there after `limit` seconds.

    The threads are daemons, so a name server that never answers does not keep the process.
    """
    results: typing.Dict[int, typing.Any] = {}
    waiting: queue.Queue = queue.Queue()
    finished: queue.Queue = queue.Queue()
    for job in enumerate(items):
        waiting.put(job)

    def work() -> None:
        while True:
            try:
                number, item = waiting.get_nowait()
            except queue.Empty:
                return
            try:
                finished.put((number, True, function(item)))
            except Exception as problem:  # raised again where it can be seen
                finished.put((number, False, problem))

    for number in range(min(workers, len(items))):
        thread = threading.Thread(target=work)
        thread.daemon = True
        thread.start()
    deadline = time.monotonic() + limit
    while len(results) < len(items):
        try:
            number, good, value = finished.get(timeout=max(0.0, deadline - time.monotonic()))
        except queue.Empty:
            break
        if not good:
            raise value
        results[number] = value
    return [results[number] if number in results else late(item) for number, item in enumerate(items)]


def awaited(
    look: typing.Callable[[], typing.Any], wanted: typing.Callable[[typing.Any], bool], deadline: float
) -> typing.Any:
    """Look again until the result is wanted, or until the deadline (monotonic seconds); return the last result."""
    while True:
        seen = look()
        if wanted(seen) or time.monotonic() + PAUSE > deadline:
            return seen
        time.sleep(PAUSE)
