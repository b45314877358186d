# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The action fleet_keys: what each computer told of its own key in, the keys of all computers of the tunnel out, and kept in a file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ansible.module_utils.parsing.convert_bool import boolean
from ansible.plugins.action import ActionBase

from ..plugin_utils._data.plain import Mismatch, from_plain
from ..plugin_utils._fleet.plain_text import LINE, plain, quote
from ..plugin_utils._observed.task_results import find_result
from ..plugin_utils._plan import tunnel
from ..plugin_utils._plan.model import FleetPlan

_MOST = 1 << 20  # bytes of the file


class ActionModule(ActionBase):
    """Joins the kept keys with those that were told, and writes the file where they differ."""

    _VALID_ARGS = frozenset(("fleet", "told", "path", "rotate"))
    _requires_connection = False

    def run(self, tmp: str | None = None, task_vars: dict[str, Any] | None = None) -> dict[str, Any]:
        """Return the keys; see ActionBase."""
        result: dict[str, Any] = super().run(tmp, task_vars)
        given, variables = self._task.args, task_vars or {}
        path = Path(str(given["path"]))
        try:
            fleet = from_plain(FleetPlan, given["fleet"])
            before = path.read_bytes()[:_MOST].decode() if path.is_file() else ""
            hosts = variables.get("ansible_play_hosts_all", ())
            results = {host: find_result(variables["hostvars"][host], str(given["told"])) for host in hosts}
            told = {host: found["public_key"] for host, found in results.items() if found and "public_key" in found}
            rotate = boolean(given.get("rotate", False))
            keys = tunnel.join_keys(tunnel.read_keys(before), told, fleet.computers, rotate)
        except (Mismatch, OSError, UnicodeDecodeError, tunnel.WrongKeys) as problem:
            where = quote(str(path), LINE)
            return {
                **result,
                "failed": True,
                "msg": plain(f"The keys of the tunnel ({where}): {problem}. Nothing was changed.", LINE),
            }
        missing = sorted(name for name, plan in fleet.computers.items() if plan.tunnel and name not in keys)
        after = tunnel.write_keys(keys)
        if after != before and not self._task.check_mode:
            path.write_text(after, encoding="utf-8")
        warnings = [
            f"{plain(name)}: it has no key in {path} yet, so it is left out of the tunnel until site.yml has run there."
            for name in missing
        ]
        difference = {"before_header": str(path), "after_header": str(path), "before": before, "after": after}
        return {
            **result,
            "changed": after != before,
            "keys_by_computer": keys,
            "diff": difference,
            "warnings": [] if self._task.check_mode else warnings,
            "msg": f"{len(keys)} computers have a key.",
        }
