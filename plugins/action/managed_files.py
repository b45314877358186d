# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The action managed_files: reads trees on the controller, runs the module, and returns its documented answer."""

from __future__ import annotations

from typing import Any

from ansible.plugins.action import ActionBase

from ..plugin_utils._changes import trees
from ..plugin_utils._changes.robot_action import Result, RobotAction


class ActionModule(RobotAction):
    """Runs the module."""

    def run(self, tmp: None = None, task_vars: dict[str, Any] | None = None) -> Result:
        """Run the module and return its result; see ActionBase."""
        result: Result = ActionBase.run(self, tmp, task_vars)
        return {**result, **self._execute_module(module_args=trees.read_trees(self._task.args), task_vars=task_vars)}
