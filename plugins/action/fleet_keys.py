# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The action fleet_keys: the answers of computers about their own keys in, the keys of all computers of the tunnel out and into a file."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ansible.module_utils.parsing.convert_bool import boolean
from ansible.plugins.action import ActionBase

from ..plugin_utils._data.plain import Mismatch, from_plain
from ..plugin_utils._fleet.plain_text import LINE, plain, quote
from ..plugin_utils._observed.task_results import find_result
from ..plugin_utils._plan import tunnel
from ..plugin_utils._plan.model import FleetPlan


class ActionModule(ActionBase):
    """Joins the kept keys with those that were told, and writes the file where they differ."""

    _VALID_ARGS = frozenset(("fleet", "told", "path", "rotate"))
    _requires_connection = False

    def run(self, tmp: str | None = None, task_vars: dict[str, Any] | None = None) -> dict[str, Any]:
        """Return the keys; see ActionBase."""
        result: dict[str, Any] = super().run(tmp, task_vars)
        given, path = self._task.args, Path(str(self._task.args["path"]))
        try:
            fleet = from_plain(FleetPlan, given["fleet"])
            before = path.read_text(encoding="utf-8") if path.is_file() else ""
            told = _read_told(task_vars or {}, str(given["told"]))
            rotate = boolean(given.get("rotate", False))
            keys = tunnel.join_keys(tunnel.read_keys(before), told, fleet.computers, rotate)
            after = tunnel.write_keys(keys)
            if after != before and not self._task.check_mode:
                _replace(path, after)
        except (Mismatch, OSError, UnicodeDecodeError, tunnel.WrongKeys) as problem:
            message = f"The keys of the tunnel ({quote(str(path), LINE)}): {problem}. Nothing was changed."
            return {**result, "failed": True, "msg": plain(message, LINE)}
        missing = sorted(name for name, plan in fleet.computers.items() if plan.tunnel and name not in keys)
        warnings = [
            f"{plain(name)}: it has no key in {path} yet, so it is left out of the tunnel until site.yml has run there."
            for name in missing
        ]
        return {
            **result,
            "changed": after != before,
            "keys_by_computer": keys,
            "diff": {"before_header": str(path), "after_header": str(path), "before": before, "after": after},
            "warnings": [] if self._task.check_mode else warnings,
            "msg": f"{len(keys)} computers have a key.",
        }


def _read_told(variables: Mapping[str, Any], name: str) -> dict[str, Any]:
    """Return the key that each computer of the run has told of itself."""
    hosts = variables.get("ansible_play_hosts_all", ())
    results = {host: find_result(variables["hostvars"][host], name) for host in hosts}
    return {host: found["public_key"] for host, found in results.items() if found and "public_key" in found}


def _replace(path: Path, content: str) -> None:
    """Replace a file in one step. Raises OSError."""
    neighbour = path.with_name(f".{path.name}.new")
    neighbour.write_text(content, encoding="utf-8")
    os.replace(neighbour, path)
