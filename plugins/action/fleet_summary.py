# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The action fleet_summary: the registered results of each computer in, a line for each computer out."""

from __future__ import annotations

from typing import Any

from ansible.utils.display import Display

from ..plugin_utils._base.plain_text import LINE, plain
from ..plugin_utils._robot_io.refusal import FleetAction
from ..plugin_utils._robot_io.summary import summarize
from ..plugin_utils._verify.observe.task_results import find_result


class ActionModule(FleetAction):
    """Prints the changes of each computer."""

    _VALID_ARGS = frozenset(("results",))

    def answer(self, args: Any, task_vars: dict[str, Any]) -> dict[str, Any]:
        """Return and print the summary."""
        names = args.get("results") or []
        hostvars = task_vars["hostvars"]
        all_hosts = task_vars.get("ansible_play_hosts_all", ())
        ended = {plain(host): [find_result(hostvars[host], name) for name in names] for host in all_hosts}
        lost = {plain(host) for host in {*all_hosts} - {*task_vars.get("ansible_play_hosts", all_hosts)}}
        first, *lines = (
            plain(line, LINE) if line[:1] != " " else "  " + plain(line, LINE)
            for line in summarize(ended, self._task.check_mode, lost)
        )
        Display().display("\n".join(["", first, *lines]))
        return {"msg": first, "computers": [line.strip() for line in lines]}
