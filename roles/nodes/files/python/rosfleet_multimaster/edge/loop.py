# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The loop of a program, its workers, and jobs that recur.

A program is one loop in its main thread. A job that may block runs in a worker, which hands its result to the loop.
Each pass of the loop feeds the watchdog, and nothing else does: a loop that hangs is seen (end_hangs.py).
"""

import contextlib
import itertools
import queue
import selectors
import socket
import threading
from functools import partial
from typing import Any, Callable, Optional, Tuple, Union

from .clock import monotonic, sleep
from .process.systemd import notify, watchdog

Job = Callable[[], Any]
Done = Callable[[Any, Optional[Exception]], Any]  # takes the result of a job, and its exception

_MAX_POSTED = 4096  # calls that wait for the loop


class Loop:
    """Runs callbacks one after the other in the thread that calls `run`."""

    def __init__(self) -> None:
        self._selector = selectors.DefaultSelector()
        self._posted: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()
        self._later: queue.PriorityQueue[Tuple[float, int, Callable[[], None]]] = queue.PriorityQueue()
        self._numbers = (
            itertools.count()
        )  # of the calls that are posted for later: two are never compared by their functions
        self._waker, self._wakee = socket.socketpair()
        self._waker.setblocking(False)
        self._wakee.setblocking(False)
        self._selector.register(self._wakee, selectors.EVENT_READ, lambda: None)
        self._thread: Optional[int] = None
        self._running, self._woken = True, False
        self.turn = 0  # the number of this pass

    def post(self, function: Callable[..., Any], *arguments: Any) -> None:
        """Have a function called in the loop; from any thread, and from a signal handler.

        Other threads wait while the loop is behind, so that they cannot fill the memory.
        """
        others = self._thread not in (None, threading.get_ident())  # the loop must not wait for itself
        while others and self._running and self._posted.qsize() >= _MAX_POSTED:
            sleep(0.01)
        self._posted.put(lambda: function(*arguments))
        self.wake()

    def post_later(self, seconds: float, function: Callable[[], None]) -> None:
        """Have a function called in the loop after a while; from any thread. No thread waits for it."""
        self._later.put((monotonic() + seconds, next(self._numbers), function))
        self.wake()

    def _call_due(self, now: float) -> float:
        """Call the functions that were posted for now; the time of the next one."""
        while not self._later.empty():  # no other thread takes from it
            due, number, function = self._later.get()
            if due > now:
                self._later.put((due, number, function))
                return due
            function()
        return float("inf")

    @property
    def queue_length(self) -> int:
        """The number of calls that wait."""
        return self._posted.qsize()

    def wake(self) -> None:
        """End the loop's sleep, once: each word to a loop that is awake costs a call of the kernel."""
        if self._woken:
            return
        self._woken = True
        with contextlib.suppress(OSError):  # full: it is awake already, or closed
            self._waker.send(b"!")

    def watch(self, readable: socket.socket, function: Callable[[], None]) -> None:
        """Have a function called when a socket can be read."""
        self._selector.register(readable, selectors.EVENT_READ, function)

    def watch_output(self, watched: socket.socket, wanted: bool) -> None:
        """Have the function of a watched socket called, too, when the socket takes bytes; or no more."""
        events = selectors.EVENT_READ | (selectors.EVENT_WRITE if wanted else 0)
        self._selector.modify(watched, events, self._selector.get_key(watched).data)

    def watch_events(self, watched: socket.socket, function: Callable[[], None], reads: bool, writes: bool) -> None:
        """Have a function called when a socket can be read or takes bytes, as is wanted; or no more."""
        events = (selectors.EVENT_READ if reads else 0) | (selectors.EVENT_WRITE if writes else 0)
        if watched not in self._selector.get_map():
            if events:
                self._selector.register(watched, events, function)
        elif events:
            self._selector.modify(watched, events, function)
        else:
            self._selector.unregister(watched)

    def forget(self, readable: socket.socket) -> None:
        """Take `watch` back."""
        self._selector.unregister(readable)

    def stop(self) -> None:
        """Let `run` return."""
        self._running = False
        self.wake()

    def run(self, tick: Callable[[float], float]) -> None:
        """Call `tick` with the time until `stop`; it returns the time at which it wants to be called again."""
        self._thread = threading.get_ident()
        every = watchdog() or float("inf")
        feed = 0.0 if every < float("inf") else every
        while self._running:
            now = monotonic()
            self.turn += 1
            if now >= feed:
                notify("WATCHDOG=1")
                feed = now + every
            due = min(
                self._call_due(now), tick(now), now + every
            )  # in this order: a call may change the work of `tick`
            for key, _events in self._selector.select(max(0.0, due - monotonic())):
                key.data()
            with contextlib.suppress(OSError):
                while self._wakee.recv(4096):
                    pass
            self._woken = False  # before the calls are counted: a thread that found it set has put its call in
            for _count in range(self._posted.qsize()):
                self._posted.get()()


class Workers:
    """A few threads for jobs that may block. They never keep the process from ending."""

    def __init__(self, loop: Loop, threads: int, waiting: int = 1024) -> None:
        self._loop = loop
        self._jobs: queue.Queue[Tuple[Job, Done]] = queue.Queue(waiting)
        for number in range(threads):
            start_thread(f"worker-{number}", self._work)

    def submit(self, job: Job, done: Done) -> None:
        """Run a job in a thread, then `done(result, exception)` in the loop."""
        try:
            self._jobs.put_nowait((job, done))
        except queue.Full:
            self._loop.post(done, None, OSError("too much to do at once"))

    def submit_later(self, seconds: float, job: Job, done: Done) -> None:
        """The same after a while."""
        self._loop.post_later(seconds, partial(self.submit, job, done))

    def _work(self) -> None:
        while True:
            job, done = self._jobs.get()
            try:
                result, problem = job(), None
            except Exception as error:  # whatever it is belongs to who asked
                result, problem = None, error
                # Its frames hold the data behind it, such as half of a large answer.
                problem.__traceback__ = problem.__context__ = problem.__cause__ = None
            self._loop.post(done, result, problem)
            del job, done, result, problem  # else they are held until the next job has ended


class DirectRunner:
    """Runs jobs at once, in the loop: for jobs that do not block."""

    def submit(self, job: Job, done: Done) -> None:
        """Run a job, then `done(result, None)`."""
        done(job(), None)


class RecurringJob:
    """A job that recurs. It has one run at a time, unless its runs may overlap.

    The program asks `tick` on each pass of its loop. `due` (a time of the monotonic clock) may be changed at any time.
    """

    def __init__(
        self,
        runner: Union[Workers, DirectRunner],
        every: Callable[[], float],
        job: Job,
        done: Done = lambda _result, _problem: None,
        wanted: Callable[[], bool] = lambda: True,
        overlapping: bool = False,
        early: float = 0.0,
    ) -> None:
        """`every`: seconds from the start of a run to the next; `wanted`: False while there is nothing to run for.

        `overlapping`: a run also starts while an earlier one hangs. `early`: so many seconds before it is due it runs, too,
        if the loop is awake: to wake it costs more than the run.
        """
        self.due = 0.0
        self._running, self._overlapping, self._early = False, overlapping, early
        self._runner, self._every, self._job, self._done, self._wanted = runner, every, job, done, wanted

    def tick(self, now: float) -> Optional[float]:
        """Start a run if one is due. Return the time of the next one.

        None: no run can start now. The end of a run wakes the loop.
        """
        if self._may_start() and now >= self.due - self._early:
            self.due, self._running = now + self._every(), True
            self._runner.submit(self._job, self._on_end)
        return self.due if self._may_start() else None

    def _may_start(self) -> bool:
        return (self._overlapping or not self._running) and self._wanted()

    def _on_end(self, result: Any, problem: Optional[Exception]) -> None:
        self._running = False
        self._done(result, problem)


def start_thread(name: str, job: Job) -> None:
    """Run a job in a thread of its own, which does not keep the process from ending."""
    threading.Thread(target=job, name=name, daemon=True).start()


def run_later(seconds: float, job: Job) -> None:
    """Run a job in a thread after a while, unless the process has ended before."""
    timer = threading.Timer(seconds, job)
    timer.daemon = True
    timer.start()


class EndFlag(threading.Event):
    """A flag that is set once, from any thread. It is true when it is set."""

    __bool__ = threading.Event.is_set


class Count:
    """A number that threads add to."""

    def __init__(self) -> None:
        self.value = 0
        self._lock = threading.Lock()

    def add(self, more: int = 1) -> None:
        """Add to it; from any thread."""
        with self._lock:
            self.value += more
