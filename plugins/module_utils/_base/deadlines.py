# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""Deadlines: many calls at the same time with one limit, and a look that is repeated until a deadline.

A slow or busy machine answers late, as do the programs that it asks on itself. A limit that does not know it takes late for never:
so limits are stretched by the pace of this machine, how many times longer everything takes than on an idle computer.
"""

import queue
import threading
import time
import typing

from .commands import text

WORKERS = 16
PAUSE = 0.5  # seconds between two looks
ROUNDS = 300_000  # of some work, by which the pace is measured
USUAL = 0.015  # seconds of a processor that the computer of a robot takes for it at most; a fast one takes a third
SLOWEST = 6.0  # times
LONGEST = 60.0  # seconds by which a limit becomes longer at most
_measured = [1.0]  # the pace


def measure_pace(waits: str = "/proc/self/schedstat") -> float:
    """Measure the pace, keep it for this process, and return how busy the machine is: 1 to SLOWEST.

    The pace is the time that the processor takes for some work, and how long this process has waited for a processor since
    its start. Only the second makes a machine busy: that of a small robot is slow, and idle.
    """
    began = time.process_time()
    for _number in range(ROUNDS):
        pass
    slow = max(1.0, (time.process_time() - began) / USUAL)
    busy = min(SLOWEST, _read_waits(waits))
    _measured[0] = round(min(SLOWEST, slow * busy), 1)
    return round(busy, 1)


def _read_waits(path: str) -> float:
    """Read how many times longer a process took since the kernel had others run meanwhile (sched-stats.rst); 1 if it is not known."""
    numbers = [int(word) for word in text(path, 200).split() if word.isdigit()]
    return 1 + numbers[1] / numbers[0] if len(numbers) > 1 and numbers[0] else 1.0


def stretch(seconds: float, longest: float = LONGEST) -> float:
    """Return a limit of time as this machine needs it, at most `longest` seconds more: unchanged before `measure_pace` was called."""
    return min(seconds * _measured[0], seconds + longest)


def call_all(function: typing.Callable, items: typing.Sequence, limit: float, late: typing.Callable) -> typing.List:
    """Call a function for each item in several threads; after `limit` seconds, at the pace of this machine, late(item) replaces a missing result.

    An exception of a call ends the calls that still wait for their beginning, and is raised here.
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
    deadline = time.monotonic() + stretch(limit)
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
