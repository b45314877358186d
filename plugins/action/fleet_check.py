# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The action fleet_check: compares the plan of a computer with its machine."""

from __future__ import annotations

from typing import Any

from ansible.module_utils.parsing.convert_bool import boolean
from ansible.plugins.action import ActionBase
from ansible.release import __version__

from ..plugin_utils._changes.refusal import refuse
from ..plugin_utils._data.plain import Mismatch, from_plain, to_plain
from ..plugin_utils._fleet.plain_text import LINE, plain
from ..plugin_utils._plan import preflight
from ..plugin_utils._plan.model import ComputerPlan


class ActionModule(ActionBase):
    """Fails with every reason why the plan cannot be applied to this machine. With `refuse: false` it only notes them."""

    _VALID_ARGS = frozenset(("plan", "machine", "refuse"))
    _requires_connection = False

    def run(self, tmp: None = None, task_vars: dict[str, Any] | None = None) -> dict[str, Any]:
        """Return the plan with the facts of the machine, its problems and its warnings; see ActionBase."""
        result: dict[str, Any] = super().run(tmp, task_vars)
        try:
            plan = from_plain(ComputerPlan, self._task.args["plan"])
        except Mismatch as problem:
            result.update(failed=True, msg=f"The option plan is no entry of computers of fleet_plan: {problem}")
            return result
        machine = self._task.args["machine"]
        if machine.get("failed"):
            result.update(failed=True, msg=preflight.explain_failure(plan.computer, machine, __version__))
            return result
        try:
            comparison = preflight.compare(plan, machine)
        # The door takes an answer by its types: keys may be missing in it, and a text may be no version or address.
        except (AttributeError, LookupError, TypeError, ValueError) as problem:
            result.update(failed=True, msg=plain(preflight.explain_strange_answer(plan.computer, problem), LINE))
            return result
        problems = [plain(text, LINE) for text in comparison.problems]
        result.update(changed=False, warnings=[plain(text, LINE) for text in comparison.warnings])
        if problems and boolean(self._task.args.get("refuse", True)):
            # Ansible prints the result of a failed task. So the plan, which no task uses then, is not in it.
            return {**result, "noted": [], **refuse(problems)}
        result.update(to_plain(comparison.plan), found=to_plain(comparison.state), problems=[], noted=problems)
        return result
