# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""Deadlines: many calls at the same time with one limit, and a look that is repeated until a deadline."""

import queue
import threading
import time
import typing

WORKERS = 16
PAUSE = 0.5  # seconds between two looks


def call_all(function: typing.Callable, items: typing.Sequence, limit: float, late: typing.Callable) -> typing.List:
    """Call a function for each item in several threads; after `limit` seconds late(item) replaces a missing result.

    What a call raises ends the others that have not begun, and is raised here.
    The threads are daemons, so a name server that never answers does not keep the process.
    """
    results: typing.Dict[int, typing.Any] = {}
    failures: typing.List[Exception] = []
    waiting: queue.Queue = queue.Queue()
    for job in enumerate(items):
        waiting.put(job)

    def work() -> None:
        while not failures:
            try:
                number, item = waiting.get_nowait()
            except queue.Empty:
                return
            try:
                results[number] = function(item)
            except Exception as problem:
                failures.append(problem)

    threads = [threading.Thread(target=work, daemon=True) for _number in range(min(WORKERS, len(items)))]
    for thread in threads:
        thread.start()
    deadline = time.monotonic() + limit
    for thread in threads:
        thread.join(max(0.0, deadline - time.monotonic()))
    if failures:
        raise failures[0]
    return [results[number] if number in results else late(item) for number, item in enumerate(items)]


def call_within(limit: float, function: typing.Callable[..., typing.Any], *arguments: typing.Any) -> typing.Any:
    """Call a function; raise TimeoutError after `limit` seconds, since a file on a dead network disk blocks."""

    def late(_arguments: typing.Any) -> typing.Any:
        raise TimeoutError(f"no answer within {limit:g} s")

    return call_all(lambda item: function(*item), [arguments], limit, late)[0]


def poll(
    look: typing.Callable[[], typing.Any], wanted: typing.Callable[[typing.Any], bool], deadline: float
) -> typing.Any:
    """Look until the result is wanted, or until the deadline (monotonic seconds); return the last result."""
    while True:
        result = look()
        if wanted(result) or time.monotonic() + PAUSE > deadline:
            return result
        time.sleep(PAUSE)
