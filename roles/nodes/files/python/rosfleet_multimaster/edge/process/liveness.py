# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""A process that is silent: whether it hangs, or waits for a processor or a disk. The kernel counts both (proc(5), schedstat).

A thread that gets no processor is in the state R, and its time on the run queue grows as fast as the clock. That of a process
that is stopped, frozen or blocked does not grow. One that computes for ever has its own processor time.
"""

import os
from typing import Dict, List, NamedTuple, Optional

from ..clock import monotonic

_SHARE = 0.5  # of the time between two samples: so long at least waits one that is starved, in all its threads together
_WINDOW = 15.0  # seconds between two samples that count at most: a clock may jump while a virtual machine is paused
_TICKS = os.sysconf("SC_CLK_TCK")


class Limits(NamedTuple):
    """The times of a judgement on a process, in seconds."""

    silence: float = 30.0  # since its last sign of life
    spent: float = 20.0  # of a processor, in this time
    idle: float = 20.0  # without a wait for a processor or a disk, up to now


class Thread(NamedTuple):
    """A thread: its state (proc(5)), its processor time and its time on the run queue (ns; 0 if the kernel does not count)."""

    state: str
    ran: int
    waited: int


class Sample(NamedTuple):
    """A process at a moment."""

    at: float  # seconds of the monotonic clock
    started: str  # when the process was started: a number that is used again has another time
    spent: float  # seconds of a processor
    threads: Dict[str, Thread]


def read_sample(pid: int, proc: str = "/proc") -> Optional[Sample]:
    """A sample of a process; None if it is gone, or not to be seen."""
    try:
        fields = _fields(f"{proc}/{pid}/stat")
        tasks = os.listdir(f"{proc}/{pid}/task")
    except (OSError, ValueError):
        return None
    threads = {}
    for task in tasks:
        try:
            threads[task] = _read_thread(f"{proc}/{pid}/task/{task}")
        except (OSError, ValueError):
            continue  # it has ended since
    return Sample(monotonic(), fields[19], (int(fields[11]) + int(fields[12])) / _TICKS, threads)


def _fields(path: str) -> List[str]:
    """Return the fields behind the name of a process, which may have any letters."""
    with open(path, encoding="utf-8", errors="replace") as file:
        return file.read().rpartition(")")[2].split()


def _read_thread(folder: str) -> Thread:
    state = _fields(f"{folder}/stat")[0]
    try:
        with open(f"{folder}/schedstat", encoding="ascii") as file:
            ran, waited, _slices = map(int, file.read().split())
    except FileNotFoundError:  # a kernel without it
        ran, waited = 0, 0
    return Thread(state, ran, waited)


def is_starved(before: Sample, after: Sample) -> bool:
    """Return True if the process waited for a processor or a disk between two samples, most of the time."""
    wall = after.at - before.at
    waited = 0.0
    for name, thread in after.threads.items():
        earlier = before.threads.get(name, Thread("", 0, 0))
        grown = (thread.waited - earlier.waited) / 1e9
        # The kernel adds a wait when it ends. Of one that lasts there is only the state.
        lasts = thread.state == "R" and (thread.ran, thread.waited) == (earlier.ran, earlier.waited)
        waited += wall if lasts or thread.state == "D" else grown
    return waited >= _SHARE * wall


class Silence:
    """A process since it was found silent."""

    def __init__(self, first: Sample) -> None:
        self._first = self._last = first
        self._idle = 0.0

    def add(self, sample: Sample) -> None:
        """Add a sample of the same process."""
        starved = is_starved(self._last, sample)
        self._idle = 0.0 if starved else self._idle + min(_WINDOW, sample.at - self._last.at)
        self._last = sample

    def is_of(self, sample: Sample) -> bool:
        """Return True if a sample is of the same process."""
        return sample.started == self._first.started

    def find_hang(self, age: float, limits: Limits) -> str:
        """The reason to think that it hangs; "" if it does not hang. `age`: seconds since its last sign of life."""
        if age < limits.silence:
            return ""
        spent = self._last.spent - self._first.spent
        if spent >= limits.spent:
            return f"it has computed for {spent:.0f} s of a processor"
        if self._idle < limits.idle:
            return ""
        stopped = all(thread.state in "Tt" for thread in self._last.threads.values())
        return "it is stopped" if stopped else "it waits, and not for a processor or a disk"
