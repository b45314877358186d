# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The workers that notify nodes of changes. They start and wake at once when there is work, and end when the work is done."""

import logging
import threading
from contextlib import closing
from typing import Any, Callable, Optional, Tuple

from ..edge.clock import monotonic
from ..edge.rpc_client import Rpc
from ..protocol.tcpros.hosts import host_of
from .core.notifications import WORKERS, NodeCall, Notifications

_log = logging.getLogger("rosfleet.notifier")

TIMEOUT = 3.0  # seconds of a call
IDLE = 10.0  # seconds that a worker waits for work before it goes


class Notifier:
    """Makes the waiting calls."""

    def __init__(self, may_call: Callable[[NodeCall], bool] = lambda _call: True) -> None:
        """`may_call(call)` is asked right before a call."""
        self._plan, self._may_call = Notifications(), may_call
        self._wake = threading.Condition()
        self._workers = self._idle = 0

    def notify(self, uri: str, method: str, name: str, arguments: Tuple[Any, ...]) -> None:
        """Queue a call of a node. It replaces the waiting one of the same method and name."""
        with self._wake:
            self._plan.add(uri, host_of(uri), method, name, arguments)
            self._call_worker()

    def _call_worker(self) -> None:
        """Wake a worker, or start one. The lock is held."""
        if self._idle:
            self._wake.notify()
        elif self._workers < WORKERS:
            self._workers += 1
            threading.Thread(target=self._work, name="notifier", daemon=True).start()

    def _work(self) -> None:
        while True:
            with self._wake:
                call = self._await()
                if call is None:
                    self._workers -= 1
                    return
                if self._plan.waits():
                    self._call_worker()  # this one may be busy for long
            answered, gone = self._make(call)
            with self._wake:
                self._plan.finish(call, monotonic(), answered, gone)

    def _await(self) -> Optional[NodeCall]:
        """The next call; None if this worker can go. The lock is held."""
        patience = monotonic() + IDLE
        while True:
            now = monotonic()
            call, due = self._plan.next(now)
            if call is not None:
                return call
            if due is None and now >= patience:
                self._plan.tidy(now)
                return None
            if due is not None and self._idle and now >= patience:
                return None  # an idle worker waits for that
            self._idle += 1
            self._wake.wait(max(0.001, (patience if due is None else due) - now))
            self._idle -= 1

    def _make(self, call: NodeCall) -> Tuple[bool, bool]:
        """Call a node: whether it answered in time, and whether its port is closed."""
        try:
            if not self._may_call(call):
                return True, False
            with closing(Rpc(call.uri, TIMEOUT)) as rpc:
                rpc.call(call.method, "/master", *call.arguments)
        except ConnectionRefusedError:
            return False, True
        except OSError as problem:
            _log.debug("%s of %s: %s", call.method, call.uri, problem)
            return False, False
        except Exception as problem:  # a fault, or a value that XML-RPC cannot carry: other nodes are notified
            _log.debug("%s of %s: %s: %s", call.method, call.uri, type(problem).__name__, problem)
        return True, False
