# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The action fleet_check: compares the plan of a computer with its machine."""

from __future__ import annotations

from typing import Any

from ansible.plugins.action import ActionBase
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._fleet.plain_text import LINE, plain
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._fleet.sentences import numbered
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan import preflight
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan.model import ComputerPlan
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan.plain import Mismatch, from_plain, to_plain


class ActionModule(ActionBase):
    """Fails with every reason why the plan cannot be applied to this machine."""

    _VALID_ARGS = frozenset(("plan", "machine"))
    _requires_connection = False

    def run(self, tmp: None = None, task_vars: dict[str, Any] | None = None) -> dict[str, Any]:
        """Return the problems, the warnings and the plan with what only the machine knows; see ActionBase."""
        result: dict[str, Any] = super().run(tmp, task_vars)
        try:
            plan = from_plain(ComputerPlan, self._task.args["plan"])
        except Mismatch as problem:
            result.update(failed=True, msg=f"The option plan is no entry of computers of fleet_plan: {problem}")
            return result
        comparison = preflight.compare(plan, self._task.args["machine"])
        result.update(
            changed=False,
            problems=[plain(text, LINE) for text in comparison.problems],
            warnings=[plain(text, LINE) for text in comparison.warnings],
            plan=to_plain(comparison.plan),
        )
        if comparison.problems:
            result.update(failed=True, msg=numbered(comparison.problems))
        return result
