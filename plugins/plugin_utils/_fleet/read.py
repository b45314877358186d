# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Reading of an inventory: variables in, the model of the fleet or sentences about what is wrong out.

Every problem of an inventory is found in one pass. First all values are read, then they are compared. The model is made
only where there is no problem, so it has no missing values.
"""

from __future__ import annotations

import dataclasses
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from ipaddress import IPv4Address, IPv4Network
from typing import Any, TypeVar

from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._fleet import (
    contradictions,
    heartbeats,
    kinds,
    networks,
    variables,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._fleet.model import (
    Computer,
    Fleet,
    Gateway,
    Robot,
    Router,
    master_name,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._fleet.values import UnexpectedValue, nearest

T = TypeVar("T")

# Values that could be read, by the names of their variables.
Values = Mapping[str, Any]


class InventoryProblems(Exception):
    """An inventory has problems: one sentence each, naming host, variable, found and expected."""

    def __init__(self, problems: Sequence[str]) -> None:
        self.problems = list(problems)
        super().__init__(" ".join(self.problems))


@dataclass(frozen=True)
class Inventory:
    """The content of Ansible's inventory that concerns the fleet, whatever `--limit` says."""

    robots: Mapping[str, Sequence[str]]  # robot -> its hosts
    variables: Mapping[str, Mapping[str, Any]]  # host -> its multimaster_* variables
    strays: Sequence[str] = ()  # hosts of the robots' group that are in none of its child groups
    routers: Sequence[str] = ()  # hosts of the group `routers`


@dataclass(frozen=True)
class _InventoryValues:
    """The values of an inventory, as far as they could be read."""

    inventory: Inventory
    hosts: Mapping[str, Values]  # by host
    shared: Values  # of the whole fleet, where the hosts agree
    own: Mapping[str, Values]  # of each robot that has hosts, where these agree

    def robots(self) -> Iterable[tuple[str, Sequence[str], Values]]:
        """Return (name, hosts, values) of each robot, also of those without hosts."""
        return ((name, hosts, self.own.get(name, {})) for name, hosts in self.inventory.robots.items())


def read_fleet(inventory: Inventory) -> Fleet:
    """Return the model of an inventory. Raises InventoryProblems with every problem that was found."""
    if not any(inventory.robots.values()) and not inventory.strays:
        raise InventoryProblems(
            [
                "The inventory has no robots: found no host in a group below the group 'robots'; expected one group per robot "
                "below 'robots', each with its computers (see inventory/single_computer/hosts.yml)."
            ]
        )
    reading, problems = _read_values(inventory)
    router, found = _read_router(reading)
    problems += found
    for name, hosts, own in reading.robots():
        problems += _robot_problems(name, hosts, own)
    problems += _ambiguous_names(reading) + _network_problems(reading, router) + _contradictions(reading)
    problems += heartbeats.find_slow_heartbeats(
        reading.shared.get("multimaster_heartbeat_hz"), reading.shared.get("multimaster_offline_after")
    )
    if not problems:
        fleet = _make_fleet(reading, router)
        problems = heartbeats.find_unreachable_masters(fleet)
    if problems:
        raise InventoryProblems(_collapse(problems, [*reading.hosts, *inventory.routers]))
    return fleet


# Reading of values


def _read_values(inventory: Inventory) -> tuple[_InventoryValues, list[str]]:
    """Read all values, and find out which ones the computers of the fleet and of each robot agree about."""
    problems: list[str] = []
    hosts = {
        host: _read_host(host, inventory.variables.get(host, {}), problems)
        for of_robot in inventory.robots.values()
        for host in of_robot
    }
    problems += _several_robots(inventory.robots) + _find_strays(inventory.strays)
    shared = _take_common_values(
        variables.OF_FLEET, list(hosts), hosts, "all computers of the fleet", "group_vars/robots.yml", problems
    )
    own = {
        name: _take_common_values(
            variables.OF_ROBOT,
            of_robot,
            hosts,
            f"the computers of the robot {name}",
            f"group_vars/{name}.yml",
            problems,
        )
        for name, of_robot in inventory.robots.items()
        if of_robot
    }
    return _InventoryValues(inventory, hosts, shared, own), problems


def _read_host(host: str, given: Mapping[str, Any], problems: list[str]) -> Values:
    """Return the values of a host, with defaults filled in. A value that is wrong is told in `problems` and left out."""
    read: dict[str, Any] = {}
    problems += _unknown(host, given)
    for variable in variables.VARIABLES:
        value = given.get(variable.name)
        value = variable.default if value is None else value  # "name:" without a value is not set
        if value is None:
            if variable.description.startswith("Required."):
                problems.append(
                    f"{host}: {variable.name} is not set; expected a value such as {variable.example}: "
                    "set it in the inventory."
                )
            continue
        try:
            read[variable.name] = variable.read(value)
        except UnexpectedValue as expected:
            problems.append(
                f"{host}: {variable.name} is {_quote_value(value)}; expected {expected}: correct it in the inventory."
            )
    if not _is_name(host):
        problems.append(
            f"{host}: its name in the inventory is '{host}'; expected a host name of letters, digits and hyphens "
            "(RFC 1123), since it is the name by which the other computers know it: rename it."
        )
    return read


def _unknown(host: str, given: Mapping[str, Any]) -> list[str]:
    return [
        f"{host}: the variable {name} is not known{nearest(name, variables.BY_NAME)}; expected one of the "
        "variables in docs/operate/variables.md: correct its name or remove it."
        for name in given
        if name not in variables.BY_NAME and name not in variables.RESERVED
    ]


def _is_name(host: str) -> bool:
    try:
        kinds.name(host)
    except UnexpectedValue:
        return False
    return host.lower() != "localhost"


def _quote_value(value: Any) -> str:
    """Return a value as a sentence has it: texts and addresses in quotes."""
    if isinstance(value, (str, IPv4Address, IPv4Network)):
        return f"'{value}'"
    return str(list(value) if isinstance(value, tuple) else value)


def _several_robots(robots: Mapping[str, Sequence[str]]) -> list[str]:
    members = defaultdict(list)
    for robot, hosts in robots.items():
        for host in hosts:
            members[host].append(robot)
    return [
        f"{host}: is in the groups of {len(of)} robots ({', '.join(of)}); expected one: remove it from the others."
        for host, of in members.items()
        if len(of) > 1
    ]


def _find_strays(strays: Sequence[str]) -> list[str]:
    return [
        f"{host}: is in the group 'robots' but in none of its robots; expected a group of its robot below 'robots': put it there."
        for host in strays
    ]


def _take_common_values(
    rows: Sequence[variables.Variable],
    hosts: Sequence[str],
    values: Mapping[str, Values],
    whom: str,
    where: str,
    problems: list[str],
) -> Values:
    """Return the values that these hosts have together. Where they disagree, the first one counts, and a problem is told."""
    agreed: dict[str, tuple[str, Any]] = {}
    for name in (row.name for row in rows):
        for host in hosts:
            if name not in values[host]:
                continue
            first, value = agreed.setdefault(name, (host, values[host][name]))
            if values[host][name] != value:
                problems.append(
                    f"{host}: {name} is {_quote_value(values[host][name])}, but {first} has {_quote_value(value)}; "
                    f"expected one value for {whom}: set it once, in {where}."
                )
    return {name: value for name, (_host, value) in agreed.items()}


def _read_router(reading: _InventoryValues) -> tuple[Router | None, list[str]]:
    """Return the router and what is wrong with it: the host of the group `routers`, or the device of the variable."""
    inventory = reading.inventory
    given = reading.shared.get("multimaster_router")
    if not inventory.routers:
        return (Router("", given) if given else None), []
    name, problems = inventory.routers[0], []
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
        return None, problems
    of_router = inventory.variables.get(name, {})
    problems += _unknown(name, of_router)
    address = of_router.get("multimaster_address")
    try:
        read = kinds.address(address)
    except UnexpectedValue as expected:
        found = "is not set" if address is None else f"is {_quote_value(address)}"
        problems.append(f"{name}: multimaster_address {found}; expected {expected}: set it in the inventory.")
        return None, problems
    if given not in (None, read):
        problems.append(
            f"{name}: multimaster_address is {read}, but multimaster_router is {given}; expected one router: leave "
            "multimaster_router out where the group 'routers' has a host."
        )
    return Router(name, read), problems


# Comparing of values


def _robot_problems(name: str, hosts: Sequence[str], own: Values) -> list[str]:
    """Return the problems of a robot: it has no computers, no master, or one port for two programs."""
    if not hosts:
        return [
            f"The robot {name} has no computers: its group is empty; expected at least one host: add it or remove the group."
        ]
    master = _master(hosts, own)
    if master is None:
        return [
            f"{hosts[0]}: multimaster_master is not set; expected the computer of the robot {name} that runs its roscore, "
            f"one of {', '.join(hosts)}: set it in group_vars/{name}.yml."
        ]
    if master not in hosts:
        return [
            f"{hosts[0]}: multimaster_master is '{master}', which is no computer of the robot {name}; expected one of "
            f"{', '.join(hosts)}{nearest(master, hosts)}: correct it in group_vars/{name}.yml."
        ]
    port = own.get("multimaster_rpc_port")
    if port is not None and port == own.get("multimaster_roscore_port"):
        return [
            f"{master}: multimaster_rpc_port is {port}, which is also the port of its roscore; expected another port: "
            "leave it out for the port of the roscore + 300."
        ]
    return []


def _master(hosts: Sequence[str], own: Values) -> str | None:
    """Return the name of a robot's master; the only computer of a robot is its master."""
    name: str | None = own.get("multimaster_master", hosts[0] if len(hosts) == 1 else None)
    return name


def _ambiguous_names(reading: _InventoryValues) -> list[str]:
    """Return a sentence for each name that does not mean one computer."""
    problems = []
    owner: dict[str, str] = {}
    for computer, values in reading.hosts.items():
        if "multimaster_address" not in values:
            continue
        for name in (computer, *values.get("multimaster_aliases", ())):
            first = owner.setdefault(name.lower(), computer)
            if first != computer:
                problems.append(
                    f"{computer}: the name {name} also means {first}; expected names that mean one computer each "
                    "(case does not count): rename one, or correct multimaster_aliases."
                )
            if name.lower() == "localhost":
                problems.append(
                    f"{computer}: multimaster_aliases has localhost, which every computer is for itself; expected names of "
                    "this computer alone: remove it."
                )
    return problems


def _network_problems(reading: _InventoryValues, router: Router | None) -> list[str]:
    given = reading.inventory.variables
    return networks.find_network_problems(
        common=reading.shared.get("multimaster_common_network"),
        addresses={
            host: values["multimaster_address"]
            for host, values in reading.hosts.items()
            if "multimaster_address" in values
        },
        robots={
            name: networks.NetworkVariables.of(hosts, own, given.get(hosts[0], {}) if hosts else {})
            for name, hosts, own in reading.robots()
        },
        router=router,
    )


def _contradictions(reading: _InventoryValues) -> list[str]:
    parties = [_party(name, hosts, reading.hosts, own) for name, hosts, own in reading.robots() if hosts]
    outside = contradictions.strangers_outside(
        reading.shared.get("multimaster_firewall"), reading.shared.get("multimaster_strangers")
    )
    kept = contradictions.diagnostics_kept(parties, reading.shared.get("multimaster_diagnostics"))
    return contradictions.find_contradictions(parties, reading.inventory.robots) + outside + kept


def _party(name: str, hosts: Sequence[str], values: Mapping[str, Values], own: Values) -> contradictions.Party:
    """Return a robot as far as it can be read; what its computers disagree about counts as not set."""
    declared = {values[host]["multimaster_exports"] for host in hosts if "multimaster_exports" in values[host]}
    filters = [values[host].get("multimaster_filters", {}) for host in hosts]
    master = own.get("multimaster_master", hosts[0])
    known = master in hosts and "multimaster_roscore_port" in own
    return contradictions.Party(
        name=name,
        host=master if master in hosts else hosts[0],
        master=master_name(master, own["multimaster_roscore_port"]) if known else "",
        declared=declared.pop() if len(declared) == 1 else None,
        filters=filters[0] if all(of_host == filters[0] for of_host in filters) else {},
    )


def _collapse(problems: Sequence[str], hosts: Sequence[str]) -> list[str]:
    """Return one sentence for a value that is wrong on many hosts, since it stands in one place of the inventory."""
    of: dict[str, list[str]] = {}
    for problem in problems:
        host, colon, text = problem.partition(": ")
        of.setdefault(text if colon and host in hosts else problem, []).append(host)
    sentences = []
    for text, named in of.items():
        others = f" and {len(named) - 3} more" if len(named) > 3 else ""
        sentences.append(text if named[0] not in hosts else f"{', '.join(named[:3])}{others}: {text}")
    return sentences


# The model


def _make_fleet(reading: _InventoryValues, router: Router | None) -> Fleet:
    """Make the model of values that have no problem."""
    rate = reading.shared["multimaster_heartbeat_hz"]
    computed = {"multimaster_offline_after": heartbeats.default_offline_after(rate)}
    return Fleet(
        robots=tuple(_make_robot(reading, name, hosts, own) for name, hosts, own in reading.robots()),
        router=router,
        variables=_make_variables(variables.FleetVariables, {**computed, **reading.shared}),
    )


def _make_robot(reading: _InventoryValues, name: str, hosts: Sequence[str], own: Values) -> Robot:
    computed = {"multimaster_rpc_port": own["multimaster_roscore_port"] + 300}
    values = _make_variables(variables.RobotVariables, {**computed, **own})
    gateway = _make_gateway(reading, values)
    computers = {host: _make_computer(reading, name, host, gateway) for host in hosts}
    return Robot(
        name=name,
        network=values.network or reading.shared["multimaster_common_network"],
        gateway=gateway,
        computers=tuple(computers.values()),
        master=computers[values.master or hosts[0]],
        variables=values,
    )


def _make_gateway(reading: _InventoryValues, own: variables.RobotVariables) -> Gateway | None:
    if own.gateway is None or own.common_address is None:
        return None
    if isinstance(own.gateway, IPv4Address):
        return Gateway("", own.gateway, own.common_address)
    return Gateway(own.gateway, reading.hosts[own.gateway]["multimaster_address"], own.common_address)


def _make_computer(reading: _InventoryValues, robot: str, host: str, gateway: Gateway | None) -> Computer:
    values = _make_variables(variables.ComputerVariables, reading.hosts[host])
    common = values.address
    if gateway is not None:
        return Computer(host, robot, gateway.common_address if host == gateway.name else None, values)
    return Computer(host, robot, common, values)


def _make_variables(kind: type[T], values: Values) -> T:
    """Make one of the classes of variables; what is not set is None."""
    return kind(**{row.name: values.get(variables.PREFIX + row.name) for row in dataclasses.fields(kind)})  # type: ignore[arg-type]  # a dataclass
