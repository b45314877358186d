# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The action multimaster_packages: runs the module apt of ansible-core, of which the documented answer comes back."""

from __future__ import annotations

from typing import Any

from ansible.plugins.action import ActionBase
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._changes.asked import Result, RobotAction


class ActionModule(RobotAction):
    """Runs apt."""

    def run(self, tmp: None = None, task_vars: dict[str, Any] | None = None) -> Result:
        """Run the module and return its result; see ActionBase."""
        result: Result = ActionBase.run(self, tmp, task_vars)
        _validated, options = self.validate_argument_spec(
            {
                "names": {"type": "list", "elements": "str", "required": True},
                "state": {"type": "str", "choices": ["present", "absent"], "default": "present"},
            }
        )
        wanted = {"name": options["names"], "state": options["state"], "install_recommends": False}
        said = self._execute_module(module_name="ansible.builtin.apt", module_args=wanted, task_vars=task_vars)
        return {**result, **said}
