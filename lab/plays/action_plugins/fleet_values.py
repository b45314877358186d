# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The action fleet_values: the variables and networks of an inventory as JSON in a file, or the problems that preflight would find.

Templates are computed with the variables of the inventory. So `multimaster_address: "{{ ansible_host }}"` is an address.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ansible.errors import AnsibleError
from ansible.plugins.action import ActionBase
from ansible_collections.rosfleet.multimaster.plugins.action.fleet_plan import read_inventory
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._base.plain import to_plain
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._base.plain_text import plain_data
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._inventory.read import InventoryProblems, read_fleet
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan.plan import fleet_plan


class ActionModule(ActionBase):
    """Reads the whole inventory, whatever `--limit` says."""

    _VALID_ARGS = frozenset(("options", "path"))
    _requires_connection = False

    def run(self, tmp: None = None, task_vars: dict[str, Any] | None = None) -> dict[str, Any]:
        """Write the file; see ActionBase."""
        result: dict[str, Any] = super().run(tmp, task_vars)
        try:
            values = fleet_values(task_vars or {}, self._task.args["options"])
        except InventoryProblems as error:
            values = {"problems": error.problems}
        Path(self._task.args["path"]).write_text(json.dumps(plain_data(values), indent=1, default=str) + "\n")
        result.update(changed=False)
        return result


def fleet_values(task_vars: Mapping[str, Any], options: Sequence[str]) -> dict[str, Any]:
    """Return robots, routers, and the variables that count. Raises InventoryProblems."""
    inventory = read_inventory(task_vars, "robots", "routers")
    plan = to_plain(fleet_plan(read_fleet(inventory)))
    return {
        "robots": inventory.robots,
        "routers": inventory.routers,
        "variables": {
            host: {**variables, **_read_options(host, task_vars["hostvars"][host], options)}
            for host, variables in inventory.variables.items()
        },
        **{key: plan[key] for key in ("common_network", "networks", "router")},
    }


def _read_options(host: str, variables: Mapping[str, Any], options: Sequence[str]) -> dict[str, Any]:
    values = {}
    for name in options:
        try:
            if name in variables:
                values[name] = variables[name]
        except AnsibleError as problem:
            raise InventoryProblems(
                [f"{host}: {name} cannot be computed ({problem}); expected a value: correct it in the inventory."]
            ) from problem
    return values
