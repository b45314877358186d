# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The action multimaster_verify: runs the module multimaster_verify, and returns its documented answer, packed if it is asked for."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ansible.module_utils.parsing.convert_bool import boolean

from ..plugin_utils._robot_io.robot_action import Result, RobotAction
from ..plugin_utils._verify.context.pairs import ALL_UP_TO
from ..plugin_utils._verify.observe.packed import pack

STOP = "systemctl stop multimaster-verify-talker.service"
# A template would visit each of their hundreds of values, for each computer and task.
OF_PLAN = ("members", "masters")


class ActionModule(RobotAction):
    """Runs the module. The talker is stopped by one command, which is faster than the start of a module."""

    def answer(self, args: Mapping[str, Any], task_vars: dict[str, Any]) -> Result:
        """Return the answer of the module, or stop the talker."""
        if args.get("action", args.get("state")) not in ("stop", "stopped"):
            args = {**take_plan(task_vars.get(str(args.get("fleet")))), **args}
            result = super().answer(args, task_vars)
            is_large = len(args.get("members") or ()) > ALL_UP_TO
            return pack(result) if is_large and boolean(args.get("packed", False)) else result
        if self._task.check_mode:
            return {"changed": False, "msg": "Check mode: no talker was stopped."}
        # A computer without ROS has no talker. A talker that cannot be stopped ends by itself.
        self._low_level_execute_command(STOP)
        return {"changed": False, "msg": "No talker runs."}


def take_plan(plan: object) -> dict[str, Any]:
    """Return the options that stand in a registered plan of the fleet; an empty dictionary for anything else."""
    return {name: plan[name] for name in OF_PLAN if name in plan} if isinstance(plan, Mapping) else {}
