# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The action managed_files: reads trees on the controller, runs the module, and returns its documented answer."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ..plugin_utils._robot_io import trees
from ..plugin_utils._robot_io.robot_action import Result, RobotAction


class ActionModule(RobotAction):
    """Runs the module."""

    def answer(self, args: Mapping[str, Any], task_vars: dict[str, Any]) -> Result:
        """Return the answer of the module, which takes files and no trees."""
        return self._execute_module(module_args=trees.read_trees(args), task_vars=task_vars)
