# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The action fleet_keys: the answers of computers about their own keys in, the keys of all computers of the tunnel out and into a file."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from ansible.module_utils.parsing.convert_bool import boolean

from ..plugin_utils._base.plain import Mismatch, from_plain
from ..plugin_utils._base.plain_text import LINE, plain, quote
from ..plugin_utils._features.tunnel import keys as tunnel
from ..plugin_utils._features.tunnel.model import Tunnel
from ..plugin_utils._plan.model import FleetPlan
from ..plugin_utils._robot_io.refusal import FleetAction, Refusal
from ..plugin_utils._verify.observe.task_results import find_result
from . import fleet_report


class ActionModule(FleetAction):
    """Joins the kept keys with those that were read on the computers, and writes the file if they differ."""

    _VALID_ARGS = frozenset(("fleet", "told", "path", "rotate"))

    def answer(self, args: Any, task_vars: dict[str, Any]) -> dict[str, Any]:
        """Return the keys."""
        path = Path(str(args["path"]))
        try:
            fleet = from_plain(FleetPlan, args["fleet"])
            _check_place(task_vars, path, fleet.computers)
            before = path.read_text(encoding="utf-8") if path.is_file() else ""
            kept = tunnel.read_keys(before)
            reported = _read_reported(task_vars, str(args["told"]), kept)
            rotate = boolean(args.get("rotate", False))
            keys, refused = tunnel.join_keys(kept, reported, fleet.computers, rotate)
            after = tunnel.write_keys(keys)
            if after != before and not self._task.check_mode:
                _replace(path, after)
        except (Mismatch, OSError, UnicodeDecodeError, tunnel.WrongKeys) as problem:
            message = f"The keys of the tunnel ({quote(str(path), LINE)}): {problem}. No tunnel was changed."
            raise Refusal(plain(message, LINE)) from None
        missing = sorted(name for name, plan in fleet.computers.items() if Tunnel.find(plan) and name not in keys)
        warnings = [
            f"{plain(name)}: it has no key in {path} yet, so it is left out of the tunnel until site.yml has run there."
            for name in missing
        ]
        return {
            "changed": after != before,
            "keys_by_computer": keys,
            "diff": {"before_header": str(path), "after_header": str(path), "before": before, "after": after},
            "refused": {name: plain(f"The keys of the tunnel: {text}.", LINE) for name, text in refused.items()},
            "warnings": [] if self._task.check_mode else warnings,
            "msg": f"{len(keys)} computers have a key.",
        }


def _read_reported(variables: Mapping[str, Any], name: str, kept: Mapping[str, str]) -> dict[str, Any]:
    """Return the key that each computer of the run has reported: the pending one, if that is the kept one already."""
    hosts = variables.get("ansible_play_hosts_all", ())
    results = {host: find_result(variables["hostvars"][host], name) for host in hosts}
    answers = {host: found for host, found in results.items() if found and "public_key" in found}
    waiting = {host: found.get("waiting_key") for host, found in answers.items()}
    return {
        host: kept[host] if host in kept and waiting[host] == kept[host] else found["public_key"]
        for host, found in answers.items()
    }


def _check_place(variables: Mapping[str, Any], path: Path, computers: Iterable[str]) -> None:
    """Refuse the folder of the inventory as the place of the file, if the run has several inventories, or no inventory. Raises tunnel.WrongKeys."""
    hosts = variables.get("hostvars", {})
    places = {str(hosts[name].get("inventory_dir")) for name in computers if name in hosts}
    if str(path.parent) in places and (len(places) > 1 or "None" in places):
        found = "no folder of an inventory" if places == {"None"} else f"inventories in {', '.join(sorted(places))}"
        raise tunnel.WrongKeys(
            f"found {found}; expected one, since all runs need the same keys: set tunnel_keys_file to its path"
        )


def _replace(path: Path, content: str) -> None:
    """Replace a file in one step; a link stays one, and so do the permissions. Raises OSError."""
    path = path.resolve()
    fleet_report.write(str(path), content, path.stat().st_mode & 0o7777 if path.exists() else fleet_report.NAMED_MODE)
