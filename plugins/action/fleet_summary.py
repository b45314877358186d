# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The action fleet_summary: the registered results of each computer in, a line for each computer out."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any

from ansible import constants
from ansible.utils.display import Display

from ..plugin_utils._base.plain_text import LINE, plain
from ..plugin_utils._robot_io.refusal import FleetAction
from ..plugin_utils._robot_io.removal import Removal, summarize_removal
from ..plugin_utils._robot_io.summary import repeat_warnings, summarize
from ..plugin_utils._verify.observe.task_results import find_result


class ActionModule(FleetAction):
    """Prints the changes of each computer, or after a teardown how each is."""

    _VALID_ARGS = frozenset(("results", "warnings", "before", "after"))

    def answer(self, args: Any, task_vars: dict[str, Any]) -> dict[str, Any]:
        """Return and print the summary."""
        ended = read_results(args.get("results"), task_vars)
        all_hosts = task_vars.get("ansible_play_hosts_all", ())
        lost = {plain(host) for host in {*all_hosts} - {*task_vars.get("ansible_play_hosts", all_hosts)}}
        if args.get("after") and not self._task.check_mode:
            found = summarize_removal(read_removals(args, ended, task_vars, lost))
        else:
            found = summarize(ended, self._task.check_mode, lost)
        warned = [spell(line) for line in repeat_warnings(read_results(args.get("warnings"), task_vars))]
        first, *lines = map(spell, found)
        Display().display("\n".join(["", first, *lines]))
        if warned:
            Display().display("\n".join(warned), color=constants.COLOR_WARN)
        return {
            "msg": first,
            "computers": [line.strip() for line in lines],
            "warned": [line.strip() for line in warned],
        }


def spell(line: str) -> str:
    """Return a line as plain text, with its indent."""
    return ("  " if line[:1] == " " else "") + plain(line, LINE)


def read_results(names: Any, task_vars: Mapping[str, Any]) -> dict[str, list[Mapping[str, Any]]]:
    """Read the registered results of these names on each computer."""
    hostvars = task_vars["hostvars"]
    all_hosts = task_vars.get("ansible_play_hosts_all", ())
    return {plain(host): [find_result(hostvars[host], name) for name in names or []] for host in all_hosts}


def read_removals(
    args: Mapping[str, Any],
    ended: Mapping[str, Sequence[Mapping[str, Any]]],
    task_vars: Mapping[str, Any],
    lost: Collection[str],
) -> dict[str, Removal]:
    """Read how a teardown went on each computer."""
    looks = read_results([str(args.get(name) or "") for name in ("before", "after")], task_vars)
    return {host: Removal(results, looks[host][0], looks[host][1], host in lost) for host, results in ended.items()}
