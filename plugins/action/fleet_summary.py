# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The action fleet_summary: the registered results of each computer in, a line for each computer out."""

from __future__ import annotations

from typing import Any

from ansible.plugins.action import ActionBase
from ansible.utils.display import Display

from ..plugin_utils._fleet.plain_text import LINE, plain
from ..plugin_utils._observed.task_results import find_result
from ..plugin_utils._report.summary import summarize


class ActionModule(ActionBase):
    """Prints the changes of each computer."""

    _VALID_ARGS = frozenset(("results",))
    _requires_connection = False

    def run(self, tmp: str | None = None, task_vars: dict[str, Any] | None = None) -> dict[str, Any]:
        """Return and print the summary; see ActionBase."""
        result: dict[str, Any] = super().run(tmp, task_vars)
        variables = task_vars or {}
        names = self._task.args.get("results") or []
        hostvars = variables["hostvars"]
        ended = {
            plain(host): [find_result(hostvars[host], name) for name in names]
            for host in variables.get("ansible_play_hosts_all", ())
        }
        first, *lines = (
            plain(line, LINE) if line[:1] != " " else "  " + plain(line, LINE)
            for line in summarize(ended, self._task.check_mode)
        )
        Display().display("\n".join(["", first, *lines]))
        return {**result, "changed": False, "msg": first, "computers": [line.strip() for line in lines]}
