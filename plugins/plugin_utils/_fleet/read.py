# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Reading of an inventory: variables in, the model of the fleet or sentences about its problems out.

One pass finds every problem. First all values are read, then they are compared. The model is made only of an inventory
without problems, so it has no missing values.
"""

from __future__ import annotations

import dataclasses
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from ipaddress import IPv4Address, IPv4Network
from typing import Any, TypeVar

from . import contradictions, heartbeats, kinds, networks, variables
from .model import Computer, Fleet, Gateway, Robot, Router, master_name
from .sentences import shorten_list
from .values import UnexpectedValue, nearest

T = TypeVar("T")

# Values that are of their kinds, by the names of their variables.
Values = Mapping[str, Any]


class InventoryProblems(Exception):
    """An inventory has problems: one sentence each, with host, variable, value and what is expected."""

    def __init__(self, problems: Sequence[str]) -> None:
        self.problems = list(problems)
        super().__init__(" ".join(self.problems))


@dataclass(frozen=True)
class Inventory:
    """The fleet's part of Ansible's inventory. `--limit` takes nothing out of it."""

    robots: Mapping[str, Sequence[str]]  # robot -> its hosts
    variables: Mapping[str, Mapping[str, Any]]  # host -> its multimaster_* variables
    strays: Sequence[str] = ()  # hosts of the robots' group outside its child groups
    routers: Sequence[str] = ()  # hosts of the group `routers`
    parts: Mapping[str, Mapping[str, Sequence[str]]] = field(
        default_factory=dict
    )  # robot -> its child groups -> their hosts


@dataclass(frozen=True)
class _InventoryValues:
    """The values of an inventory that are of their kinds."""

    inventory: Inventory
    hosts: Mapping[str, Values]  # by host
    shared: Values  # of the whole fleet, if its hosts agree
    own: Mapping[str, Values]  # of each robot with hosts, if these agree

    def robots(self) -> Iterable[tuple[str, Sequence[str], Values]]:
        """Return (name, hosts, values) of each robot, also of those without hosts."""
        return ((name, hosts, self.own.get(name, {})) for name, hosts in self.inventory.robots.items())

    def seals(self) -> Mapping[str, kinds.SealedComputer]:
        """Return the sealed computers of all robots."""
        return {name: entry for own in self.own.values() for name, entry in own.get("multimaster_sealed", {}).items()}


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
    inventory = _open_collections(inventory, problems)
    reading = _read_values(inventory, problems)
    router = _read_router(reading, problems)
    for name, hosts, own in reading.robots():
        problems += _find_robot_problems(name, hosts, own, inventory.variables)
    problems += [
        *_find_ambiguous_names(reading),
        *_find_network_problems(reading, router),
        *_find_contradictions(reading),
        *networks.find_wrong_tunnel_network(reading.shared),
    ]
    problems += heartbeats.find_slow_heartbeats(
        reading.shared.get("multimaster_heartbeat_hz"), reading.shared.get("multimaster_offline_after")
    )
    if not problems:
        values = networks.move_into_tunnel(reading.hosts, reading.shared, reading.own)
        fleet = _make_fleet(_InventoryValues(inventory, *values), router)
        problems = [*heartbeats.find_unreachable_masters(fleet), *contradictions.find_wrong_clock(fleet)]
        problems += contradictions.find_wrong_tunnel(fleet)
        problems += contradictions.find_wrong_frames(fleet)
    if problems:
        raise InventoryProblems(_collapse(problems, [*reading.hosts, *inventory.routers]))
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
            f"The group {name}: stands between 'robots' and the groups {', '.join(groups)}, so it is one robot, but its computers "
            "have no multimaster_master in common; expected each robot directly below 'robots': put these groups there. Is it "
            f"one robot? Then set multimaster_master in group_vars/{name}.yml."
        )
        robots.update(groups)
        strays += [host for host in hosts if not any(host in members for members in groups.values())]
    return dataclasses.replace(inventory, robots=robots, strays=strays)


# Reading of values


def _read_values(inventory: Inventory, problems: list[str]) -> _InventoryValues:
    """Read all values, and take those that the computers of the fleet and of each robot agree about."""
    hosts = {
        host: _read_host(host, inventory.variables.get(host, {}), problems)
        for members in inventory.robots.values()
        for host in members
    }
    problems += _find_shared_hosts(inventory.robots) + _find_strays(inventory.strays)
    shared = _take_common_values("", list(hosts), hosts, problems)
    robots = {name: members for name, members in inventory.robots.items() if members}
    own = {name: _take_common_values(name, members, hosts, problems) for name, members in robots.items()}
    return _InventoryValues(inventory, hosts, shared, own)


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
    if host.lower() == "localhost":
        problems.append(
            f"{host}: its name in the inventory is '{host}', which every computer is for itself; expected the name by which the other "
            "computers know it: rename it. With ansible_connection: local, Ansible still does not use ssh for it."
        )
    elif not kinds.is_host_name(host):
        problems.append(
            f"{host}: its name in the inventory is '{host}'; expected a host name of letters, digits and hyphens "
            "(RFC 1123), since it is the name by which the other computers know it: rename it."
        )
    return values


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


def _take_common_values(robot: str, hosts: Sequence[str], values: Mapping[str, Values], problems: list[str]) -> Values:
    """Return the values that the computers of a robot, or without one those of the fleet, have together.

    If they disagree, the first one counts, with a sentence in `problems`.
    """
    whom = f"the computers of the robot {robot}" if robot else "all computers of the fleet"
    common: dict[str, tuple[str, Any]] = {}
    for name in (row.name for row in (variables.OF_ROBOT if robot else variables.OF_FLEET)):
        for host in hosts:
            if name not in values[host]:
                continue
            first, value = common.setdefault(name, (host, values[host][name]))
            if values[host][name] != value:
                problems.append(
                    f"{host}: {name} is {_quote_value(values[host][name])}, but {first} has {_quote_value(value)}; "
                    f"expected one value for {whom}: set it once, in group_vars/{robot or 'robots'}.yml."
                )
    return {name: value for name, (_host, value) in common.items()}


def _read_router(reading: _InventoryValues, problems: list[str]) -> Router | None:
    """Return the router. It is the host of the group `routers`, or the device of the variable."""
    inventory = reading.inventory
    device = reading.shared.get("multimaster_router")
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
            "multimaster_router out where the group 'routers' has a host."
        )
    return Router(name, address)


# Comparing of values


def _find_robot_problems(
    name: str, hosts: Sequence[str], own: Values, raw: Mapping[str, Mapping[str, Any]]
) -> Iterator[str]:
    """Yield the problem of a robot: it has no computers, no master, or one port for two programs."""
    # The only computer of a robot is its master.
    master = own.get("multimaster_master", hosts[0] if len(hosts) == 1 else None)
    computers = [*hosts, *own.get("multimaster_sealed", ())]
    port = own.get("multimaster_rpc_port")
    if not hosts:
        yield f"The robot {name} has no computers: its group is empty; expected at least one host: add it or remove the group."
    elif master is None and any(raw.get(host, {}).get("multimaster_master") is not None for host in hosts):
        pass  # it is set, to what cannot be read: that has its sentence
    elif master is None:
        yield (
            f"{hosts[0]}: multimaster_master is not set; expected the computer of the robot {name} that runs its roscore, "
            f"one of {', '.join(computers)}: set it in group_vars/{name}.yml."
        )
    elif master not in computers and "multimaster_sealed" in own:
        yield (
            f"{hosts[0]}: multimaster_master is '{master}', which is no computer of the robot {name}; expected one of "
            f"{', '.join(computers)}{nearest(master, computers)}: correct it in group_vars/{name}.yml."
        )
    elif port is not None and port == own.get("multimaster_roscore_port"):
        yield (
            f"{master}: multimaster_rpc_port is {port}, which is also the port of its roscore; expected another port: "
            "leave it out for the port of the roscore + 300."
        )


def _find_ambiguous_names(reading: _InventoryValues) -> Iterator[str]:
    """Yield a sentence for each name of two computers, and for localhost."""
    owner: dict[str, str] = {}
    aliases = {
        host: values.get("multimaster_aliases", ())
        for host, values in reading.hosts.items()
        if "multimaster_address" in values
    }
    aliases |= {name: entry.aliases for name, entry in reading.seals().items() if name not in aliases}
    for computer, others in aliases.items():
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
                    "this computer alone: remove it."
                )


def _find_network_problems(reading: _InventoryValues, router: Router | None) -> list[str]:
    raw = reading.inventory.variables
    return networks.find_network_problems(
        common=reading.shared.get("multimaster_common_network"),
        tunnel=reading.shared.get("multimaster_tunnel_network"),
        addresses={name: entry.address for name, entry in reading.seals().items()}
        | {
            host: values["multimaster_address"]
            for host, values in reading.hosts.items()
            if "multimaster_address" in values
        },
        robots={
            name: networks.NetworkVariables.from_values(hosts, own, raw.get(hosts[0], {}) if hosts else {})
            for name, hosts, own in reading.robots()
        },
        router=router,
    )


def _find_contradictions(reading: _InventoryValues) -> list[str]:
    parties = [_make_party(name, hosts, reading.hosts, own) for name, hosts, own in reading.robots() if hosts]
    firewall, strangers, diagnostics = (
        reading.shared.get(f"multimaster_{name}") for name in ("firewall", "strangers", "diagnostics")
    )
    return [
        *contradictions.find_contradictions(parties, reading.inventory.robots),
        *contradictions.find_excluded_strangers(firewall, strangers),
        *contradictions.find_local_diagnostics(parties, diagnostics),
        *contradictions.find_wrong_seals(
            [_make_sealed_robot(reading, name, hosts, own) for name, hosts, own in reading.robots() if hosts],
            {*reading.hosts, *reading.inventory.routers},
            reading.shared.get("multimaster_advertise"),
        ),
    ]


def _make_sealed_robot(
    reading: _InventoryValues, name: str, hosts: Sequence[str], own: Values
) -> contradictions.SealedRobot:
    return contradictions.SealedRobot(
        name=name,
        hosts=hosts,
        sealed=own.get("multimaster_sealed", {}),
        master=own.get("multimaster_master"),
        companion=own.get("multimaster_companion"),
        gateway=own.get("multimaster_gateway"),
        provider=own.get("multimaster_provider"),
        # Its default means nothing here: what counts is what the inventory says.
        roscore=reading.inventory.variables.get(hosts[0], {}).get("multimaster_roscore"),
    )


def _make_party(name: str, hosts: Sequence[str], values: Mapping[str, Values], own: Values) -> contradictions.Party:
    """Return a robot as far as it can be read. A variable counts as not set if its computers disagree."""
    declarations = {values[host]["multimaster_exports"] for host in hosts if "multimaster_exports" in values[host]}
    filters = [values[host].get("multimaster_filters", {}) for host in hosts]
    master = own.get("multimaster_master", hosts[0])
    is_known = master in (*hosts, *own.get("multimaster_sealed", ())) and "multimaster_roscore_port" in own
    return contradictions.Party(
        name=name,
        host=master if master in hosts else hosts[0],
        master=master_name(master, own["multimaster_roscore_port"]) if is_known else "",
        declaration=declarations.pop() if len(declarations) == 1 else None,
        filters=filters[0] if all(other == filters[0] for other in filters) else {},
    )


def _collapse(problems: Sequence[str], hosts: Sequence[str]) -> list[str]:
    """Return one sentence for a value that is wrong on many hosts, since it stands in one place of the inventory."""
    hosts_by_text: dict[str, list[str]] = {}
    for problem in problems:
        host, colon, text = problem.partition(": ")
        hosts_by_text.setdefault(text if colon and host in hosts else problem, []).append(host)
    return [
        text if names[0] not in hosts else f"{shorten_list(names)}: {text}" for text, names in hosts_by_text.items()
    ]


# The model


def _make_fleet(reading: _InventoryValues, router: Router | None) -> Fleet:
    """Make the model of values without problems."""
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
    computers |= {
        sealed: _make_sealed_computer(name, sealed, entry, gateway) for sealed, entry in values.sealed.items()
    }
    master = computers[values.master or hosts[0]]
    return Robot(
        name=name,
        network=values.network or reading.shared["multimaster_common_network"],
        gateway=gateway,
        computers=tuple(computers.values()),
        master=master,
        companion=computers[values.companion or hosts[0]] if master.sealed else master,
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
    if gateway is None:
        return Computer(host, robot, values.address, values)
    return Computer(host, robot, gateway.common_address if host == gateway.name else None, values)


def _make_sealed_computer(robot: str, name: str, entry: kinds.SealedComputer, gateway: Gateway | None) -> Computer:
    raw = {"multimaster_address": entry.address, "multimaster_aliases": list(entry.aliases)}
    defaults = {row.name: row.read(row.default) for row in variables.OF_COMPUTER if row.default is not None}
    values = _make_variables(variables.ComputerVariables, {**defaults, **raw})
    return Computer(name, robot, None if gateway else entry.address, values, sealed=True)


def _make_variables(kind: type[T], values: Values) -> T:
    """Make one of the classes of variables. None: not set."""
    return kind(**{row.name: values.get(variables.PREFIX + row.name) for row in dataclasses.fields(kind)})  # type: ignore[arg-type]  # a dataclass
