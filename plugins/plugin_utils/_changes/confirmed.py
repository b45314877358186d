# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The controller's side of the dead-man's switch: what the first run of a module changed at run time, a second run
confirms over a new TCP connection. Without it the machine takes the change back by itself, see docs/dead_mans_switch.md.
"""

from __future__ import annotations

import contextlib
import secrets
import signal
import threading
import time

from ansible.errors import AnsibleAuthenticationFailure, AnsibleConnectionFailure
from ansible.plugins.action import ActionBase
from ansible.plugins.connection import ConnectionBase

GRACE = 60.0  # seconds for a run of the module, and for reaching the machine after its former state is back
PAUSE = 1.0  # seconds between two attempts
# What ssh says when no session ever began; then nothing can have changed.
NEVER_BEGAN = (
    "ssh: connect to host",
    "Could not resolve hostname",
    "Host key verification failed",
    "Permission denied",
    "banner exchange",
)


class GuardedAction(ActionBase):
    """Runs the module of its own name once where nothing changes at run time, else a second time to confirm."""

    what = "settings"  # the concern in a sentence, in the plural

    def run(self, tmp=None, task_vars=None):
        result = super().run(tmp, task_vars)
        args = {name: value for name, value in self._task.args.items() if name != "confirmation"}
        seconds = _seconds(args.get("confirm_within"))
        if seconds and (self._task.check_mode or self._connection.transport == "local"):
            args["confirm_within"] = seconds = 0  # nothing changes, or no connection can be cut
        if not seconds:
            return {**result, **self._execute_module(module_args=args, task_vars=task_vars)}
        return {**result, **self._guarded(args, seconds, task_vars)}

    def _guarded(self, args, seconds, task_vars):
        """The result of both runs, as one."""
        confirming = {**args, "confirm_within": 0, "confirmation": secrets.token_hex(8)}
        first, reason = self._first({**confirming, "confirm_within": seconds}, seconds, task_vars)
        if first and not first.get("unconfirmed"):
            return _with_crash(first, self.what, seconds)

        last = time.monotonic() + seconds + GRACE
        while True:
            try:
                self._new_connection()
                second = self._attempt(confirming, task_vars, seconds + GRACE)
            except AnsibleConnectionFailure as problem:
                reason = _line(problem)
            else:
                if not second.get("unconfirmed"):
                    return _merged(first, second)
                reason = "every connection was the one from before the change"
            if time.monotonic() > last:
                return {
                    "failed": True,
                    "msg": f"The {self.what} may have cut the machine off, which was to take them back after {seconds} s "
                    f"by itself, but the controller has not reached it since ({reason}): look at it at its console.",
                }
            time.sleep(PAUSE)

    def _first(self, args, seconds, task_vars):
        """The result of the first run, and why there is none."""
        last = time.monotonic() + seconds + GRACE
        while True:
            try:
                # What is sent again after the way back doubles its pauses, so it may come as late as twice the time.
                return self._attempt(args, task_vars, 2 * seconds + GRACE), ""
            except AnsibleConnectionFailure as problem:
                if not self._never_began(problem):
                    return {}, _line(problem)
                # The same task may have cut this machine's gateway off, which comes back.
                if time.monotonic() > last or isinstance(problem, AnsibleAuthenticationFailure):
                    raise
            time.sleep(PAUSE)

    def _attempt(self, args, task_vars, limit):
        """One run of the module, or AnsibleConnectionFailure."""
        with _bounded(limit):
            return self._execute_module(module_args=args, task_vars=task_vars)

    def _new_connection(self):
        """Leave a kept connection; a plugin that keeps none has no reset()."""
        if type(self._connection).reset is not ConnectionBase.reset:
            self._connection.reset()

    def _never_began(self, problem):
        """Whether a failed first run has certainly not reached the machine."""
        if isinstance(problem, AnsibleAuthenticationFailure):
            return True
        # With a temporary folder the machine has been reached before, in the same task.
        return self._connection._shell.tmpdir is None and any(words in str(problem) for words in NEVER_BEGAN)


def _seconds(value):
    """The option as a number; 0 leaves it to the module to complain."""
    try:
        return max(int(value or 0), 0)
    except (TypeError, ValueError):
        return 0


def _line(problem):
    return " ".join(str(problem).split()).rstrip(".")


def _merged(first, second):
    """The first run's result says what changed; the second's only whether it lasts."""
    if second.get("failed") or not first:
        return second
    return {**first, "unconfirmed": False, "confirmed": True}


def _with_crash(first, what, seconds):
    """A module that was ended by force may have changed something before."""
    if first.get("failed") and "unconfirmed" not in first and "module_stdout" in first:
        first["msg"] = (
            f"{first.get('msg', '')} The {what} that it may have changed are taken back by the machine within {seconds} s."
        )
    return first


class _Expired(BaseException):
    """Not an Exception: connection plugins catch those and try again."""


@contextlib.contextmanager
def _bounded(seconds):
    """Give up after this time: without an answer, ssh waits for as long as TCP does, hours.

    A task's own `timeout` is set by the same alarm and bounds it as well.
    """

    def ring(number, frame):
        raise _Expired

    if threading.current_thread() is not threading.main_thread() or signal.getitimer(signal.ITIMER_REAL)[0]:
        yield
        return
    former = signal.signal(signal.SIGALRM, ring)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    except _Expired:
        raise AnsibleConnectionFailure(f"no answer within {seconds:.0f} s") from None
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, former)
