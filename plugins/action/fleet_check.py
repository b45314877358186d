# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The action fleet_check: compares the plan of a computer with its machine."""

from __future__ import annotations

from typing import Any

from ansible.module_utils.parsing.convert_bool import boolean
from ansible.release import __version__

from ..plugin_utils._base.plain import Mismatch, from_plain, to_plain
from ..plugin_utils._base.plain_text import LINE, plain
from ..plugin_utils._plan import preflight
from ..plugin_utils._plan.model import ComputerPlan, RobotNetwork
from ..plugin_utils._robot_io.refusal import FleetAction, Refusal, refuse


class ActionModule(FleetAction):
    """Fails with every reason why the plan cannot be applied to this machine. With `refuse: false` it only notes them."""

    _VALID_ARGS = frozenset(("plan", "machine", "networks", "refuse"))

    def answer(self, args: Any, task_vars: dict[str, Any]) -> dict[str, Any]:
        """Return the plan with the facts of the machine, its problems and its warnings."""
        try:
            plan = from_plain(ComputerPlan, args["plan"])
            networks = [from_plain(RobotNetwork, entry) for entry in args.get("networks") or ()]
        except Mismatch as problem:
            raise Refusal(f"The option plan is no entry of computers of fleet_plan: {problem}") from None
        machine = args["machine"]
        if machine.get("failed"):
            raise Refusal(preflight.explain_failure(plan.computer, machine, __version__))
        try:
            comparison = preflight.compare(plan, machine, networks)
        # The door takes an answer by its types: keys may be missing in it, and a text may be no version or address.
        except (AttributeError, LookupError, TypeError, ValueError) as problem:
            raise Refusal(plain(preflight.explain_strange_answer(plan.computer, problem), LINE)) from None
        problems = [plain(text, LINE) for text in comparison.problems]
        warnings = [plain(text, LINE) for text in comparison.warnings]
        if problems and boolean(args.get("refuse", True)):
            # Ansible prints the result of a failed task. So the plan, which no task uses then, is not in it.
            return refuse(problems, warnings=warnings, noted=[])
        plain_plan, found = to_plain(comparison.plan), to_plain(comparison.state)
        return {**plain_plan, "warnings": warnings, "found": found, "problems": [], "noted": problems}
