# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The action multimaster_verify: runs the module multimaster_verify, and returns its documented answer."""

from __future__ import annotations

from typing import Any

from ansible.plugins.action import ActionBase

from ..plugin_utils._changes.robot_action import Result, RobotAction

STOP = "systemctl stop multimaster-verify-talker.service"


class ActionModule(RobotAction):
    """Runs the module. The talker is stopped by one command, which is faster than the start of a module."""

    def run(self, tmp: None = None, task_vars: dict[str, Any] | None = None) -> Result:
        """Run the module and return its result; see ActionBase."""
        if self._task.args.get("action", self._task.args.get("state")) not in ("stop", "stopped"):
            answer: Result = super().run(tmp, task_vars)
            return answer
        result: Result = ActionBase.run(self, tmp, task_vars)
        if self._task.check_mode:
            return {**result, "changed": False, "msg": "Check mode: no talker was stopped."}
        # A computer without ROS has no talker. A talker that cannot be stopped ends by itself.
        self._low_level_execute_command(STOP)
        return {**result, "changed": False, "msg": "No talker runs."}
