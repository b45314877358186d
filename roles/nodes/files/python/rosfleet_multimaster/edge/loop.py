# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The loop of a program, its workers, and jobs that recur.

A program is one loop in its main thread. What may block runs in a worker, which hands its result to the loop.
"""

import queue
import selectors
import socket
import threading
from typing import Any, Callable, Optional, Tuple

from .clock import monotonic, sleep

_MAX_POSTED = 4096  # calls that wait for the loop


class Loop:
    """Runs callbacks one after the other in the thread that calls `run`."""

    def __init__(self) -> None:
        self._selector = selectors.DefaultSelector()
        self._posted: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()
        self._waker, self._wakee = socket.socketpair()
        self._waker.setblocking(False)
        self._wakee.setblocking(False)
        self._selector.register(self._wakee, selectors.EVENT_READ, lambda: None)
        self._thread: Optional[int] = None
        self._running = True

    def post(self, function: Callable[..., Any], *arguments: Any) -> None:
        """Have a function called in the loop; from any thread, and from a signal handler.

        Other threads wait while the loop is behind, so that they cannot fill the memory.
        """
        others = self._thread not in (None, threading.get_ident())  # the loop must not wait for itself
        while others and self._running and self._posted.qsize() >= _MAX_POSTED:
            sleep(0.01)
        self._posted.put(lambda: function(*arguments))
        self.wake()

    def wake(self) -> None:
        """End the loop's sleep."""
        try:
            self._waker.send(b"!")
        except OSError:  # full: it is awake already, or closed
            pass

    def watch(self, readable: socket.socket, function: Callable[[], None]) -> None:
        """Have a function called when a socket can be read."""
        self._selector.register(readable, selectors.EVENT_READ, function)

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
        while self._running:
            due = tick(monotonic())
            for key, _events in self._selector.select(max(0.0, due - monotonic())):
                key.data()
            try:
                while self._wakee.recv(4096):
                    pass
            except OSError:
                pass
            for _count in range(self._posted.qsize()):
                self._posted.get()()


class Workers:
    """A few threads for what may block. They never keep the process from ending."""

    def __init__(self, loop: Loop, threads: int, waiting: int = 1024) -> None:
        self._loop = loop
        self._jobs: queue.Queue[Tuple[Callable[[], Any], Callable[[Any, Optional[Exception]], None]]] = queue.Queue(
            waiting
        )
        for number in range(threads):
            threading.Thread(target=self._work, name=f"worker-{number}", daemon=True).start()

    def submit(self, job: Callable[[], Any], done: Callable[[Any, Optional[Exception]], None]) -> None:
        """Run a job in a thread, then `done(result, exception)` in the loop."""
        try:
            self._jobs.put_nowait((job, done))
        except queue.Full:
            self._loop.post(done, None, OSError("too much to do at once"))

    def _work(self) -> None:
        while True:
            job, done = self._jobs.get()
            try:
                result, problem = job(), None
            except Exception as error:  # whatever it is belongs to who asked
                result, problem = None, error
            self._loop.post(done, result, problem)
