# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The action fleet_plan: the variables of Ansible's inventory in, the plan of the fleet or sentences out."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from ansible.errors import AnsibleError
from ansible.module_utils.common.arg_spec import ArgumentSpecValidator

from ..plugin_utils._base.plain import to_plain
from ..plugin_utils._inventory import places, read, roles, variables
from ..plugin_utils._inventory.model import Inventory
from ..plugin_utils._inventory.rows import PREFIX
from ..plugin_utils._plan.plan import fleet_plan
from ..plugin_utils._robot_io.refusal import FleetAction, refuse
from ..plugin_utils._robot_io.ssh import list_ssh_ports

MOST_GROUPS = 500  # groups and files of them that are looked at, to name the right one
LARGEST = 1 << 20  # bytes of a file


class ActionModule(FleetAction):
    """Computes the plan of all computers from the whole inventory, whatever `--limit` says."""

    _VALID_ARGS = frozenset(("group", "router_group"))

    def answer(self, args: Any, task_vars: dict[str, Any]) -> dict[str, Any]:
        """Return the plan as the result."""
        problems: list[str] = []
        try:
            inventory = read_inventory(task_vars, args.get("group", "robots"), args.get("router_group", "routers"))
            problems = check_options(task_vars["hostvars"], inventory.variables)
            plan = fleet_plan(read.read_fleet(inventory))
        except read.InventoryProblems as error:
            problems = [*error.problems, *problems]
        if problems:
            return refuse(name_places(problems, task_vars, args.get("group", "robots")))
        return {
            "msg": f"{len(plan.masters)} robots with {len(plan.members)} computers on {plan.common_network}",
            **to_plain(plan),
            "ssh_ports": list_ssh_ports(task_vars["hostvars"]),
        }


def read_inventory(task_vars: Mapping[str, Any], group: str, router_group: str) -> Inventory:
    """Return the robots, the router and their variables as Ansible's inventory has them.

    The groups directly below `group` are the robots. Ansible hands out groups without their order of descent,
    except through the object behind `hostvars`.
    """
    hostvars = task_vars["hostvars"]
    root = hostvars._inventory.groups.get(group)
    children = [] if root is None else sorted(root.child_groups, key=lambda child: child.name)
    robots = {str(child.name): _host_names(child) for child in children}
    hosts = [host for of_robot in robots.values() for host in of_robot]
    members = [] if root is None else _host_names(root)
    of_router = hostvars._inventory.groups.get(router_group)
    routers = [] if of_router is None else _host_names(of_router)
    return Inventory(
        robots=robots,
        variables={host: _variables_of(host, hostvars[host]) for host in (*hosts, *routers)},
        strays=[host for host in members if host not in hosts],
        routers=routers,
        parts={
            str(child.name): {str(part.name): _host_names(part) for part in child.child_groups} for child in children
        },
    )


def name_places(problems: list[str], task_vars: Mapping[str, Any], group: str) -> list[str]:
    """Name in each problem the file of the inventory that has its variable: it may be that of a group above the robot."""
    hostvars = task_vars["hostvars"]
    root = hostvars._inventory.groups.get(group)
    hosts = [(host, str(child.name)) for child in (root.child_groups if root else ()) for host in child.get_hosts()]
    members = {
        str(host.name): places.HostMembership(robot, sorted(str(one.name) for one in host.get_groups()))
        for host, robot in hosts[:MOST_GROUPS]
    }
    folders = {
        str(values[key])
        for host in members
        for values in [hostvars[host]]
        for key in ("inventory_dir", "playbook_dir")
        if values.get(key)
    }
    named = sorted({name for member in members.values() for name in (member.robot, *member.groups)})
    return places.name_files(problems, members, {name: _read_files(folders, name) for name in named[:MOST_GROUPS]})


def _read_files(folders: Iterable[str], group: str) -> dict[str, str]:
    """Read the files with the variables of a group: their names in the inventory, with their texts."""
    found = {}
    for folder in sorted(folders):
        base = Path(folder) / "group_vars"
        paths = [base / f"{group}{ending}" for ending in ("", ".yml", ".yaml", ".json")]
        paths += sorted((base / group).glob("*"))[:MOST_GROUPS] if (base / group).is_dir() else []
        for path in paths:
            try:
                if path.is_file() and path.stat().st_size <= LARGEST:
                    found[f"group_vars/{path.relative_to(base)}"] = path.read_text(encoding="utf-8")
            except (OSError, ValueError):  # one that cannot be read is Ansible's to complain of
                continue
    return found


def _host_names(group: Any) -> list[str]:
    """Return the names of the hosts of a group of Ansible's, with those of its child groups."""
    return [str(host.name) for host in group.get_hosts()]


def _variables_of(host: str, hostvars: Mapping[str, Any]) -> dict[str, Any]:
    values = {}
    for name in hostvars:
        if name.startswith(PREFIX) and name not in variables.RESERVED:
            try:
                values[str(name)] = hostvars[name]
            except AnsibleError as problem:
                raise read.InventoryProblems(
                    [f"{host}: {name} cannot be computed ({problem}); expected a value: correct it in the inventory."]
                ) from problem
    return values


def check_options(hostvars: Mapping[str, Any], hosts: Iterable[str]) -> list[str]:
    """Return a sentence for each variable of a host that is nearly an option of a role, or has a value that its role refuses."""
    options = roles.read_options()
    problems = []
    for host in hosts:
        values = hostvars[host]
        problems += [roles.say_misspelt(host, *pair) for pair in roles.find_misspelt(values, options).items()]
        problems += [
            roles.say_wrong(host, name, values[name], options[name])
            for name in options
            if name in values and not _is_allowed(name, values, options[name])
        ]
    return problems


def _is_allowed(name: str, values: Mapping[str, Any], specification: roles.Specification) -> bool:
    try:
        given = {name: values[name]}
        return not ArgumentSpecValidator({name: dict(specification)}).validate(given).error_messages
    except AnsibleError:  # it depends on facts that are not known yet: the role checks it
        return True
