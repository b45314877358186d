# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Tasks that may refuse: the actions that run only on the controller, and problems as the result of a task."""

from __future__ import annotations

import os
import shlex
from collections.abc import Mapping, Sequence
from typing import Any

from ansible import constants
from ansible.errors import AnsibleActionFail
from ansible.plugins.action import ActionBase
from ansible.release import __version__
from ansible.utils.display import Display

from .._base.plain_text import LINE, plain
from .._base.sentences import number_problems

SHOWS_ORIGINS = (2, 19)  # since then Ansible prints of a failed task also the place of its lines


class Refusal(Exception):
    """A task refuses. The text is its message."""


class PlainFailure(AnsibleActionFail):  # type: ignore[misc]  # ansible-core has no types
    """A task fails as it is meant to: Ansible prints its message, and no place in a file of ours, as of a mistake there."""

    @property
    def omit_exception_key(self) -> bool:
        """True, so that ansible-core 2.19 and later leave out the error with its origin."""
        return True


class FleetAction(ActionBase):  # type: ignore[misc]  # ansible-core has no types
    """Needs no connection: options and the registered results of computers in, an answer out."""

    _requires_connection = False

    def run(self, tmp: str | None = None, task_vars: dict[str, Any] | None = None) -> dict[str, Any]:
        """Return the answer of the action, or its refusal; see ActionBase."""
        result: dict[str, Any] = super().run(tmp, task_vars)
        try:
            return {**result, "changed": False, **self.answer(self._task.args, task_vars or {})}
        except Refusal as problem:
            return fail_plainly(str(problem), **result)

    def answer(self, args: Mapping[str, Any], task_vars: dict[str, Any]) -> dict[str, Any]:
        """Return the answer to the options of the task. Raises Refusal."""
        raise NotImplementedError


def refuse(problems: Sequence[str], **values: Any) -> dict[str, Any]:
    """Fail with these problems, and these values in the result; see fail_plainly. Several are printed, since a result is one line."""
    message = number_problems(problems)
    if len(problems) > 1:
        Display().display(message, color=constants.COLOR_ERROR, stderr=True)
    return fail_plainly(message, problems=list(problems), **values)


def fail_plainly(message: str, **values: Any) -> dict[str, Any]:
    """Return the result of a task that fails as it is meant to; with ansible-core 2.19 and later, raise PlainFailure for it."""
    if _read_version(__version__) >= SHOWS_ORIGINS:
        for warning in values.get("warnings", ()):  # Ansible leaves those of an exception out
            Display().warning(plain(warning, LINE))
        raise PlainFailure(message, result={"changed": False, **values})
    return {"changed": False, **values, "failed": True, "msg": message}


def _read_version(text: str) -> tuple[int, ...]:
    """Return the first two numbers of a version of ansible-core."""
    return tuple(int(part) for part in text.split(".")[:2])


def name_inventory(task_vars: Mapping[str, Any]) -> str:
    """Name the inventory of this run as a command has it after -i, also a list such as `host,`; empty if Ansible names no inventory."""
    sources = [str(source) for source in task_vars.get("ansible_inventory_sources") or ()]
    paths = [source if "," in source else min(source, os.path.relpath(source), key=len) for source in sources]
    return " -i ".join(map(shlex.quote, paths))
