# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The controller's side of the dead-man's switch.

The first run of a module changes something at run time. A second run confirms it over a new TCP connection. Without the
second run the machine rolls the change back by itself, see docs/understand/dead_mans_switch.md.
"""

from __future__ import annotations

import secrets
import time
from collections.abc import Mapping
from typing import Any

from ansible.errors import AnsibleAuthenticationFailure, AnsibleConnectionFailure
from ansible.plugins.connection import ConnectionBase

from .._base.plain_text import LINE, plain
from .robot_action import RobotAction, limit_time

GRACE = 60.0  # seconds for a run of the module, and to reach the machine after its rollback
LONGEST = 600  # seconds that are believed of a slow machine
PAUSE = 1.0  # seconds between two attempts
# Messages of ssh without a session: nothing can have changed.
UNSTARTED = (
    "ssh: connect to host",
    "Could not resolve hostname",
    "Host key verification failed",
    "Permission denied",
    "banner exchange",
)


Result = dict[str, Any]  # of a module


class GuardedAction(RobotAction):
    """Runs the module of its own name: once if nothing changes at run time, else a second time to confirm."""

    what = "settings"  # the concern in a sentence, in the plural

    def answer(self, args: Mapping[str, Any], task_vars: dict[str, Any]) -> Result:
        """Return the answer of one run of the module, or of two."""
        args = {name: value for name, value in args.items() if name != "confirmation"}
        seconds = seconds_of(args.get("confirm_within"))
        if seconds and self.cannot_be_cut:
            args["confirm_within"] = seconds = 0
        if not seconds:
            return self._execute_module(module_args=args, task_vars=task_vars)
        confirming = {**args, "confirm_within": 0, "confirmation": secrets.token_hex(8)}
        first, reason = self._run_first({**confirming, "confirm_within": seconds}, seconds, task_vars)
        if first and not first.get("unconfirmed"):
            return first
        return _merge(first, self._run_second(confirming, wait_of(first, seconds), reason, task_vars))

    @property
    def cannot_be_cut(self) -> bool:
        """True if nothing changes, or no connection can be cut."""
        return bool(self._task.check_mode or self._connection.transport == "local")

    def _run_second(
        self, args: Mapping[str, Any], seconds: int, reason: str, task_vars: dict[str, Any], more: float = 0.0
    ) -> Result:
        """Return the result of the run that confirms, over a new connection. It has `more` seconds besides those of the switch."""
        last = time.monotonic() + seconds + GRACE
        while True:
            try:
                self._reconnect()
                second = self._attempt(args, task_vars, seconds + GRACE + more)
            except AnsibleConnectionFailure as problem:
                reason = _line(problem)
            else:
                if not second.get("unconfirmed"):
                    return second
                reason = "every connection was the one from before the change"
            if time.monotonic() > last:
                return {
                    "failed": True,
                    "msg": f"The {self.what} may have cut the machine off, which was to take them back after {seconds} s "
                    f"by itself, but the controller has not reached it since ({reason}): look at it at its console.",
                }
            time.sleep(PAUSE)

    def _run_first(
        self, args: Mapping[str, Any], seconds: int, task_vars: dict[str, Any], more: float = 0.0
    ) -> tuple[Result, str]:
        """Return the result of the first run, or an empty result and the reason. The run has `more` seconds besides those of the switch."""
        last = time.monotonic() + seconds + GRACE
        while True:
            try:
                # TCP doubles its pauses between retries. After a rollback an answer may come as late as twice the time.
                first = self._attempt(args, task_vars, 2 * seconds + GRACE + more)
                return _explain_crash(first, self.what, seconds), ""
            except AnsibleConnectionFailure as problem:
                if not self._is_unstarted(problem):
                    return {}, _line(problem)
                # The same task may have cut off the gateway of this machine; it comes back after its rollback.
                if time.monotonic() > last or isinstance(problem, AnsibleAuthenticationFailure):
                    raise
            time.sleep(PAUSE)

    def _attempt(self, args: Mapping[str, Any], task_vars: dict[str, Any], limit: float) -> Result:
        """Run the module once. Raises AnsibleConnectionFailure, also after `limit` seconds."""
        with limit_time(limit):
            # Ansible writes into the options, so it gets a copy.
            return self._execute_module(module_args={**args}, task_vars=task_vars)

    def _reconnect(self) -> None:
        """Close a connection that stays open between tasks. A plugin without such connections has no reset()."""
        if type(self._connection).reset is not ConnectionBase.reset:
            self._connection.reset()

    def _is_unstarted(self, problem: AnsibleConnectionFailure) -> bool:
        """Return True if the failed run has certainly not reached the machine."""
        if isinstance(problem, AnsibleAuthenticationFailure):
            return True
        # A temporary folder shows that this task has reached the machine before.
        return self._connection._shell.tmpdir is None and any(words in str(problem) for words in UNSTARTED)


def wait_of(first: Result, seconds: int) -> int:
    """Return for how many seconds the machine waits for its confirmation: longer than the given time, if it is slow."""
    return min(max(seconds, seconds_of(first.get("confirm_within"))), max(seconds, LONGEST))


def seconds_of(value: Any) -> int:
    """Return the option as a number. A value that is no number is 0 here; the module refuses it."""
    try:
        return max(int(value or 0), 0)
    except (TypeError, ValueError):
        return 0


def _line(problem: Exception) -> str:
    return plain(problem, LINE).rstrip(".")


def _merge(first: Result, second: Result) -> Result:
    """Merge two results: the first has the changes, the second their confirmation."""
    if second.get("failed") or not first:
        return second
    return {**first, "unconfirmed": False, "confirmed": True}


def _explain_crash(first: Result, what: str, seconds: int) -> Result:
    """Add a sentence to the result of a module that crashed, since it may have changed something before."""
    if first.get("failed") and "unconfirmed" not in first and "module_stdout" in first:
        first["msg"] = (
            f"{first.get('msg', '')} The {what} that it may have changed are taken back by the machine within {seconds} s."
        )
    return first
