# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The action multimaster_verify: where the first run of the module has kept a process, that one does the second run."""

from __future__ import annotations

from typing import Any

from ansible.plugins.action import ActionBase
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._changes.kept import Result, can_visit, visit


class ActionModule(ActionBase):
    """Asks the kept process for the second run; starts the module for the others, and where there is no such process."""

    _supports_async = True

    def run(self, tmp: None = None, task_vars: dict[str, Any] | None = None) -> Result:
        """Run the module and return its result; see ActionBase."""
        result: Result = super().run(tmp, task_vars)
        options = {name: value for name, value in self._task.args.items() if value is not None}
        wrap_async = bool(self._task.async_val)
        if options.get("state", "collected") == "collected" and not wrap_async:
            found = visit(self, options, str(options.get("run", "default")))
            if found:
                return {**result, **found}
        elif options.get("state") == "started" and can_visit(self):
            options["keep"] = True
        return {**result, **self._execute_module(module_args=options, task_vars=task_vars, wrap_async=wrap_async)}
