# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Reading of an inventory: variables in, the model of the fleet or sentences about its problems out.

One pass finds every problem. First all values are read into the model, then they are compared. Only a model without problems
is returned, so it has no missing values.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from ipaddress import IPv4Address, IPv4Network
from typing import Any

from .._base.features import load_hooks
from .._base.sentences import UnexpectedValue, nearest, shorten_list
from . import contradictions, flows, heartbeats, kinds, networks, variables
from .hooks import InventoryHooks
from .model import Computer, Fleet, Inventory, Robot, Router, Values


class InventoryProblems(Exception):
    """An inventory has problems: one sentence each, with host, variable, found and expected value."""

    def __init__(self, problems: Sequence[str]) -> None:
        self.problems = list(problems)
        super().__init__(" ".join(self.problems))


def read_fleet(inventory: Inventory) -> Fleet:
    """Return the model of an inventory. Raises InventoryProblems with every problem."""
    if not any(inventory.robots.values()) and not inventory.strays:
        raise InventoryProblems(
            [
                "The inventory has no robots: found no host in a group below the group 'robots'; expected one group per robot "
                "below 'robots', each with its computers (see inventory/single_computer/hosts.yml)."
            ]
        )
    problems: list[str] = []
    features = load_hooks("inventory", InventoryHooks).values()
    inventory = _open_collections(inventory, problems)
    fleet = _read_values(inventory, problems)
    for robot in fleet.robots:
        problems += _find_robot_problems(robot, inventory)
    problems += [
        *_find_ambiguous_names(fleet),
        *networks.find_network_problems(fleet, inventory),
        *contradictions.find_contradictions(fleet, inventory),
        *heartbeats.find_slow_heartbeats(fleet.variables.heartbeat_hz, fleet.variables.offline_after),
    ]
    problems += [sentence for hooks in features for sentence in hooks.find_wrong_variables(fleet.variables)]
    if not problems:
        for hooks in features:
            fleet = hooks.change_fleet(fleet, inventory)
        fleet = heartbeats.fill_offline_after(fleet)
        problems = [
            *heartbeats.find_unreachable_masters(fleet),
            *(sentence for hooks in features for sentence in hooks.find_contradictions(fleet)),
            *contradictions.find_wrong_frames(fleet),
            *contradictions.find_wrong_relay_ports(fleet),
        ]
    if problems:
        raise InventoryProblems(_collapse(problems, inventory.hosts))
    return fleet


# Groups


def _open_collections(inventory: Inventory, problems: list[str]) -> Inventory:
    """Return the inventory with its robots directly below `robots`, as the corrected one has them.

    A group of several robots looks like one robot whose computers agree on no master. Of the robots in it, the other
    sentences are true; of the group, none would be.
    """
    robots: dict[str, Sequence[str]] = {}
    strays = list(inventory.strays)
    for name, hosts in inventory.robots.items():
        groups = {group: members for group, members in inventory.parts.get(name, {}).items() if members}
        masters = {str(inventory.variables.get(host, {}).get("multimaster_master")) for host in hosts}
        is_robot = len(groups) < 2 or len(hosts) < 2 or (len(masters) == 1 and masters != {"None"})
        if is_robot:
            robots[name] = hosts
            continue
        problems.append(
            f"The group {name}: is between 'robots' and the groups {', '.join(groups)}, so it is one robot, but its computers "
            "have no multimaster_master in common; expected each robot directly below 'robots': put these groups there. Is it "
            f"one robot? Then set multimaster_master in group_vars/{name}.yml."
        )
        robots.update(groups)
        strays += [host for host in hosts if not any(host in members for members in groups.values())]
    return replace(inventory, robots=robots, strays=strays)


# Reading of values


def _read_values(inventory: Inventory, problems: list[str]) -> Fleet:
    """Read all values, and take those that the computers of the fleet and of each robot agree about."""
    hosts = {
        host: _read_host(host, inventory.variables.get(host, {}), problems)
        for members in inventory.robots.values()
        for host in members
    }
    problems += _find_shared_hosts(inventory.robots) + _find_strays(inventory.strays)
    shared = variables.make(variables.FleetVariables, _take_common_values("", list(hosts), hosts, problems))
    computers = {host: variables.make(variables.ComputerVariables, values) for host, values in hosts.items()}
    robots = []
    for name, members in inventory.robots.items():
        own = variables.make(variables.RobotVariables, _take_common_values(name, members, hosts, problems))
        own = replace(own, rpc_port=own.rpc_port or (own.roscore_port or 0) + flows.RPC_PORT)
        robots.append(make_robot(name, {host: computers[host] for host in members}, own, shared.common_network))
    return Fleet(tuple(robots), _read_router(inventory, shared.router, problems), shared)


def make_robot(
    name: str,
    hosts: Mapping[str, variables.ComputerVariables],
    own: variables.RobotVariables,
    common_network: IPv4Network,
) -> Robot:
    """Make a robot of its values."""
    of_all = [(host, values, False) for host, values in hosts.items()]
    of_all += [(sealed, _fill_up(entry), True) for sealed, entry in (own.sealed or {}).items()]
    # Behind a gateway, only this one is in the common network.
    is_behind = own.gateway is not None and own.common_address is not None
    reached = {own.gateway: own.common_address} if is_behind else {host: each.address for host, each, _sealed in of_all}
    computers = [Computer(each, name, reached.get(each), values, sealed) for each, values, sealed in of_all]
    return Robot(name, own.network or common_network, tuple(computers), own)


def _fill_up(entry: kinds.SealedComputer) -> variables.ComputerVariables:
    """Return the variables of a sealed computer. Those that it cannot have are as by default."""
    defaults = {row.name: row.read(row.default) for row in variables.OF_COMPUTER if row.default is not None}
    filled = variables.make(variables.ComputerVariables, defaults)
    return replace(filled, address=entry.address, aliases=list(entry.aliases))


def _read_host(host: str, raw: Mapping[str, Any], problems: list[str]) -> Values:
    """Return the values of a host, with defaults filled in. A wrong value is left out, with a sentence in `problems`."""
    values: dict[str, Any] = {}
    problems += _find_unknown(host, raw)
    for variable in variables.VARIABLES:
        value = raw.get(variable.name)
        value = variable.default if value is None else value  # "name:" without a value is not set
        if value is None:
            if variable.example:
                problems.append(
                    f"{host}: {variable.name} is not set; expected a value such as {variable.example}: "
                    "set it in the inventory."
                )
            continue
        try:
            values[variable.name] = variable.read(value)
        except UnexpectedValue as expected:
            problems.append(
                f"{host}: {variable.name} is {_quote_value(value)}; expected {expected}: correct it in the inventory."
            )
    problems += _find_wrong_name(host)
    return values


def _find_wrong_name(host: str) -> Iterator[str]:
    """Yield a sentence where other computers cannot know a computer by its name in the inventory."""
    if host.lower() == "localhost":
        yield (
            f"{host}: its name in the inventory is '{host}', which every computer is for itself; expected the name by which the other "
            "computers know it: rename it. With ansible_connection: local, Ansible still does not use ssh for it."
        )
    elif not kinds.is_host_name(host):
        other = host.replace("_", "-")
        way = f" to '{other}', with multimaster_aliases: [{host}]" if kinds.is_host_name(other) else ""
        yield (
            f"{host}: its name in the inventory is '{host}'; expected a host name of letters, digits and hyphens "
            f"(RFC 1123) whose last part is no number, since it is the name by which the other computers know it: rename it{way}."
        )


def _find_unknown(host: str, raw: Mapping[str, Any]) -> list[str]:
    return [
        f"{host}: the variable {name} is not known{nearest(name, variables.BY_NAME)}; expected one of the "
        "variables in docs/operate/variables.md: correct its name or remove it."
        for name in raw
        if name not in variables.BY_NAME and name not in variables.RESERVED
    ]


def _quote_value(value: Any) -> str:
    """Return a value for a sentence: texts and addresses in quotes."""
    if isinstance(value, (str, IPv4Address, IPv4Network)):
        return f"'{value}'"
    return str(list(value) if isinstance(value, tuple) else value)


def _find_shared_hosts(robots: Mapping[str, Sequence[str]]) -> list[str]:
    groups = defaultdict(list)
    for robot, hosts in robots.items():
        for host in hosts:
            groups[host].append(robot)
    return [
        f"{host}: is in the groups of {len(names)} robots ({', '.join(names)}); expected one: remove it from the others."
        for host, names in groups.items()
        if len(names) > 1
    ]


def _find_strays(strays: Sequence[str]) -> list[str]:
    return [
        f"{host}: is in the group 'robots' but in none of its robots; expected a group of its robot below 'robots': put it there."
        for host in strays
    ]


#: They are compared with those of other robots, name by name.
DECLARED = {"multimaster_exports", "multimaster_filters"}


def _take_common_values(robot: str, hosts: Sequence[str], values: Mapping[str, Values], problems: list[str]) -> Values:
    """Return the values that the computers of a robot, or without one those of the fleet, have together.

    If they disagree, the first one counts, with a sentence in `problems`. Of declarations that disagree, not even the first counts.
    """
    whom = f"the computers of the robot {robot}" if robot else "all computers of the fleet"
    common: dict[str, tuple[str, Any]] = {}
    disputed = set()
    for name in (row.name for row in (variables.OF_ROBOT if robot else variables.OF_FLEET)):
        for host in hosts:
            if name not in values[host]:
                continue
            first, value = common.setdefault(name, (host, values[host][name]))
            if values[host][name] != value:
                disputed.add(name)
                problems.append(
                    f"{host}: {name} is {_quote_value(values[host][name])}, but {first} has {_quote_value(value)}; "
                    f"expected one value for {whom}: set it once, in group_vars/{robot or 'robots'}.yml."
                )
    return {name: value for name, (_host, value) in common.items() if name not in disputed & DECLARED}


def _read_router(inventory: Inventory, device: IPv4Address | None, problems: list[str]) -> Router | None:
    """Return the router. It is the host of the group `routers`, or the device of the variable."""
    if not inventory.routers:
        return Router("", device) if device else None
    name = inventory.routers[0]
    if len(inventory.routers) > 1:
        problems.append(
            f"{name}: the group 'routers' has {len(inventory.routers)} hosts ({', '.join(inventory.routers)}); expected one, the "
            "device that manages the common network: remove the others."
        )
    if any(name in hosts for hosts in inventory.robots.values()):
        problems.append(
            f"{name}: is in the group 'routers' and a computer of a robot; expected one of the two, since a robot's computer on the "
            "common network gets its routes as such: remove it from the group 'routers'."
        )
        return None
    raw = inventory.variables.get(name, {})
    problems += _find_unknown(name, raw)
    value = raw.get("multimaster_address")
    try:
        address = kinds.address(value)
    except UnexpectedValue as expected:
        state = "is not set" if value is None else f"is {_quote_value(value)}"
        problems.append(f"{name}: multimaster_address {state}; expected {expected}: set it in the inventory.")
        return None
    if device not in (None, address):
        problems.append(
            f"{name}: multimaster_address is {address}, but multimaster_router is {device}; expected one router: leave "
            "multimaster_router out if the group 'routers' has a host."
        )
    return Router(name, address)


# Comparing of values


def _find_robot_problems(robot: Robot, inventory: Inventory) -> Iterator[str]:
    """Yield the problem of a robot: it has no computers, no master, or one port for two programs."""
    name, hosts, own, computers = robot.name, robot.hosts, robot.variables, [*robot.hosts, *robot.seals]
    # The only computer of a robot is its master.
    master = own.master or (hosts[0] if len(hosts) == 1 else None)
    if not hosts:
        yield f"The robot {name} has no computers: its group is empty; expected at least one host: add it or remove the group."
    elif master is None and any(inventory.is_set(host, "master") for host in hosts):
        pass  # it is set, to a value that cannot be read: that has its sentence
    elif master is None:
        yield (
            f"{hosts[0]}: multimaster_master is not set; expected the computer of the robot {name} that runs its roscore, "
            f"one of {', '.join(computers)}: set it in {robot.file}."
        )
    elif master not in computers and own.sealed is not None:
        yield (
            f"{hosts[0]}: multimaster_master is '{master}', which is no computer of the robot {name}; expected one of "
            f"{', '.join(computers)}{nearest(master, computers)}: correct it in {robot.file}."
        )
    elif own.rpc_port == own.roscore_port:
        yield (
            f"{master}: multimaster_rpc_port is {own.rpc_port}, which is also the port of its roscore; expected another port: "
            "leave it out for the port of the roscore + 300."
        )


def _find_ambiguous_names(fleet: Fleet) -> Iterator[str]:
    """Yield a sentence for each name of two computers, and for localhost."""
    owner: dict[str, str] = {}
    talkers: dict[str, str] = {}  # name of a computer as the topic of its talker has it
    aliases: dict[str, Sequence[str]] = {}
    for each in sorted(fleet.computers, key=lambda computer: computer.sealed):
        if each.address:
            aliases.setdefault(each.name, each.variables.aliases or ())
    for computer, others in aliases.items():
        in_ros = re.sub(r"\W", "_", computer)
        first = talkers.setdefault(in_ros, computer)
        if first != computer:
            yield (
                f"{computer}: it and {first} both become {in_ros} in ROS, so the verification would take one for the other; expected names "
                "that differ in letters or digits: rename one of them."
            )
        for name in (computer, *others):
            first = owner.setdefault(name.lower(), computer)
            if first != computer:
                yield (
                    f"{computer}: the name {name} also means {first}; expected names that mean one computer each "
                    "(case does not count): rename one, or correct multimaster_aliases."
                )
            if name.lower() == "localhost" and name != computer:
                yield (
                    f"{computer}: multimaster_aliases has localhost, which every computer is for itself; expected names of "
                    "only this computer: remove it."
                )


def _collapse(problems: Sequence[str], hosts: Sequence[str]) -> list[str]:
    """Return one sentence for a value that is wrong on many hosts, since it is in one place of the inventory."""
    hosts_by_text: dict[str, list[str]] = {}
    for problem in problems:
        host, colon, text = problem.partition(": ")
        hosts_by_text.setdefault(text if colon and host in hosts else problem, []).append(host)
    return [
        text if names[0] not in hosts else f"{shorten_list(names)}: {text}" for text, names in hosts_by_text.items()
    ]
