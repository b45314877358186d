# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The fleet: robots, their computers and what they share, read from the inventory's variables and validated.

Pure: mappings in, a model or sentences out. Every problem of an inventory is found in one pass.
"""

from __future__ import annotations

import ipaddress
import math
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._fleet import contradictions, networks
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._fleet import flows as flows_module
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._fleet import variables as variables_module
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._fleet.exports import Export
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._fleet.values import Unexpected, nearest


class InventoryProblems(Exception):
    """What is wrong with the inventory: one sentence each, naming host, variable, found and expected."""

    def __init__(self, problems: Sequence[str]) -> None:
        self.problems = list(problems)
        super().__init__(" ".join(self.problems))


@dataclass(frozen=True)
class Inventory:
    """What is read of Ansible's inventory, whatever `--limit` says."""

    robots: Mapping[str, Sequence[str]]  # robot -> its hosts
    variables: Mapping[str, Mapping[str, Any]]  # host -> its multimaster_* variables
    strays: Sequence[str] = ()  # hosts of the robots' group that are in none of its child groups
    routers: Sequence[str] = ()  # hosts of the group `routers`


@dataclass(frozen=True)
class Computer:
    """One computer of a robot."""

    name: str
    robot: str
    address: str
    aliases: tuple[str, ...]
    ros_setup: str
    common_address: str  # its address in the common network; empty behind a gateway

    @property
    def discovery_address(self) -> str:
        """The address that discovery uses: the one in the common network, where there is one."""
        return self.common_address or self.address


@dataclass(frozen=True)
class Gateway:
    """What connects a robot's own network with the common network."""

    name: str  # the computer; empty for a device that is no computer of the inventory
    address: str  # in the robot's network
    common_address: str


@dataclass(frozen=True)
class Robot:
    """One robot: its computers, the one that runs its roscore, and the way out of its network."""

    name: str
    network: str  # the common network, where it has none of its own
    gateway: Gateway | None  # none in the common network
    routes: str
    computers: tuple[Computer, ...]
    master: Computer
    roscore: str
    roscore_port: int
    rpc_port: int
    filters: Mapping[str, list[str]] = field(default_factory=dict)
    exports: tuple[Export, ...] | None = None  # none declared: everything to everybody
    provider: str = "bundled"

    @property
    def master_name(self) -> str:
        """The name of its master."""
        return master_name(self.master.name, self.roscore_port)


def master_name(computer: str, roscore_port: int) -> str:
    """The name of a master: its computer, and the port where that is not ROS's usual one (as upstream does)."""
    return computer.lower() if roscore_port == 11311 else f"{computer.lower()}_{roscore_port}"


@dataclass(frozen=True)
class Router:
    """The device that manages the common network (section 4.1 of the report)."""

    name: str  # the host; empty for a device that is not in the inventory
    address: str


@dataclass(frozen=True)
class Fleet:
    """All robots and what they share."""

    robots: tuple[Robot, ...]
    common_network: str
    router: Router | None
    transport: str
    multicast_routing: str
    multicast_group: str
    multicast_port: int
    answer_broadcast_pings: bool
    advertise: str
    heartbeat_hz: float
    offline_after: float

    @property
    def computers(self) -> tuple[Computer, ...]:
        """The computers of all robots, in the order of the inventory."""
        return tuple(computer for robot in self.robots for computer in robot.computers)

    @cached_property
    def flows(self) -> tuple[flows_module.Flow, ...]:
        """What flows by declaration; robots that declare nothing give everything to everybody."""
        return flows_module.flows({robot.name: robot.exports for robot in self.robots})

    @cached_property
    def declared(self) -> bool:
        """Whether any robot declares what it gives."""
        return any(robot.exports is not None for robot in self.robots)


def read_fleet(inventory: Inventory) -> Fleet:
    """The model of an inventory. Raises InventoryProblems with every problem that was found."""
    problems: list[str] = []
    if not any(inventory.robots.values()) and not inventory.strays:
        raise InventoryProblems(
            [
                "The inventory has no robots: found no host in a group below the group 'robots'; expected one group per robot "
                "below 'robots', each with its computers (see inventory/single_computer/hosts.yml)."
            ]
        )
    values = {
        host: _read_host(host, inventory.variables.get(host, {}), problems)
        for hosts in inventory.robots.values()
        for host in hosts
    }
    problems += _one_robot_each(inventory.robots) + _no_strays(inventory.strays)
    shared = _shared_values(values, problems)
    own = {name: _own_values(name, hosts, values, problems) for name, hosts in inventory.robots.items() if hosts}
    router = _read_router(inventory, shared, problems)
    robots = []
    for name, hosts in inventory.robots.items():
        robot = _read_robot(name, hosts, values, own.get(name, {}), problems)
        if robot is not None:
            robots.append(robot)
    problems += _unique_names(
        [
            (host, [host, *values[host].get("multimaster_aliases", [])])
            for host in values
            if "multimaster_address" in values[host]
        ]
    )
    problems += networks.problems(
        common=shared.get("multimaster_common_network", ""),
        addresses={host: read["multimaster_address"] for host, read in values.items() if "multimaster_address" in read},
        robots={
            name: networks.Layout.of(hosts, own.get(name, {}), inventory.variables.get(hosts[0], {}) if hosts else {})
            for name, hosts in inventory.robots.items()
        },
        router=(router.name, router.address) if router else None,
    )
    problems += contradictions.problems(
        [_party(name, hosts, values, own[name]) for name, hosts in inventory.robots.items() if hosts], inventory.robots
    )
    problems += _too_few_heartbeats(shared)
    if not problems:
        problems += _unreached_masters(robots, shared)
    if problems or not robots:
        raise InventoryProblems(_collapsed(problems, [*values, *inventory.routers]))
    return Fleet(
        robots=tuple(robots),
        common_network=shared["multimaster_common_network"],
        router=router,
        transport=shared["multimaster_transport"],
        multicast_routing=shared["multimaster_multicast_routing"],
        multicast_group=shared["multimaster_multicast_group"],
        multicast_port=shared["multimaster_multicast_port"],
        answer_broadcast_pings=shared["multimaster_answer_broadcast_pings"],
        advertise=shared["multimaster_advertise"],
        heartbeat_hz=shared["multimaster_heartbeat_hz"],
        offline_after=shared.get("multimaster_offline_after", _offline_after(shared["multimaster_heartbeat_hz"])),
    )


def _read_host(host: str, given: Mapping[str, Any], problems: list[str]) -> dict[str, Any]:
    """The host's variables of the right kind, defaults filled in; what is wrong goes to problems and stays out."""
    read: dict[str, Any] = {}
    problems += _unknown(host, given)
    for variable in variables_module.VARIABLES:
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
        except Unexpected as expected:
            problems.append(
                f"{host}: {variable.name} is {_shown(value)}; expected {expected}: correct it in the inventory."
            )
    if not _is_name(host):
        problems.append(
            f"{host}: its name in the inventory is '{host}'; expected a host name of letters, digits and hyphens "
            "(RFC 1123), since it is the name by which the other computers know it: rename it."
        )
    return read


def _unknown(host: str, given: Mapping[str, Any]) -> list[str]:
    return [
        f"{host}: the variable {name} is not known{nearest(name, variables_module.BY_NAME)}; expected one of the "
        "variables in the README: correct its name or remove it."
        for name in given
        if name not in variables_module.BY_NAME and name not in variables_module.RESERVED
    ]


def _collapsed(problems: Sequence[str], hosts: Sequence[str]) -> list[str]:
    """One sentence for a value that is wrong on many hosts, since it stands in one place of the inventory."""
    of: dict[str, list[str]] = {}
    for problem in problems:
        host, colon, text = problem.partition(": ")
        of.setdefault(text if colon and host in hosts else problem, []).append(host)
    sentences = []
    for text, named in of.items():
        others = f" and {len(named) - 3} more" if len(named) > 3 else ""
        sentences.append(text if named[0] not in hosts else f"{', '.join(named[:3])}{others}: {text}")
    return sentences


def _is_name(host: str) -> bool:
    try:
        variables_module.BY_NAME["multimaster_master"].read(host)
    except Unexpected:
        return False
    return host.lower() != "localhost"


def _shown(value: Any) -> str:
    value = list(value) if isinstance(value, tuple) else value
    return f"'{value}'" if isinstance(value, str) else str(value)


def _one_robot_each(robots: Mapping[str, Sequence[str]]) -> list[str]:
    members = defaultdict(list)
    for robot, hosts in robots.items():
        for host in hosts:
            members[host].append(robot)
    return [
        f"{host}: is in the groups of {len(of)} robots ({', '.join(of)}); expected one: remove it from the others."
        for host, of in members.items()
        if len(of) > 1
    ]


def _no_strays(strays: Sequence[str]) -> list[str]:
    return [
        f"{host}: is in the group 'robots' but in none of its robots; expected a group of its robot below 'robots': put it there."
        for host in strays
    ]


def _shared_values(values: Mapping[str, Mapping[str, Any]], problems: list[str]) -> dict[str, Any]:
    """The variables of the whole fleet; hosts that disagree are a problem."""
    names = [variable.name for variable in variables_module.VARIABLES if variable.scope == "fleet"]
    return _agreed(names, list(values), values, "all computers of the fleet", "group_vars/robots.yml", problems)


def _agreed(
    names: Sequence[str],
    hosts: Sequence[str],
    values: Mapping[str, Mapping[str, Any]],
    whom: str,
    where: str,
    problems: list[str],
) -> dict[str, Any]:
    agreed: dict[str, Any] = {}
    for name in names:
        for host in hosts:
            if name not in values[host]:
                continue
            first = agreed.setdefault(name, (host, values[host][name]))
            if values[host][name] != first[1]:
                problems.append(
                    f"{host}: {name} is {_shown(values[host][name])}, but {first[0]} has {_shown(first[1])}; "
                    f"expected one value for {whom}: set it once, in {where}."
                )
    return {name: value for name, (_host, value) in agreed.items()}


def _own_values(
    name: str, hosts: Sequence[str], values: Mapping[str, Mapping[str, Any]], problems: list[str]
) -> dict[str, Any]:
    """The variables of one robot; hosts that disagree are a problem."""
    names = [variable.name for variable in variables_module.VARIABLES if variable.scope == "robot"]
    return _agreed(names, hosts, values, f"the computers of the robot {name}", f"group_vars/{name}.yml", problems)


def _read_robot(
    name: str,
    hosts: Sequence[str],
    values: Mapping[str, Mapping[str, Any]],
    own: Mapping[str, Any],
    problems: list[str],
) -> Robot | None:
    if not hosts:
        problems.append(
            f"The robot {name} has no computers: its group is empty; expected at least one host: add it or remove the group."
        )
        return None
    master = own.get("multimaster_master", hosts[0] if len(hosts) == 1 else None)
    if master is None:
        problems.append(
            f"{hosts[0]}: multimaster_master is not set; expected the computer of the robot {name} that runs its roscore, "
            f"one of {', '.join(hosts)}: set it in group_vars/{name}.yml."
        )
        return None
    if master not in hosts:
        problems.append(
            f"{hosts[0]}: multimaster_master is '{master}', which is no computer of the robot {name}; expected one of "
            f"{', '.join(hosts)}{nearest(master, hosts)}: correct it in group_vars/{name}.yml."
        )
        return None
    roscore_port = own.get("multimaster_roscore_port")
    rpc_port = own.get("multimaster_rpc_port", (roscore_port or 0) + 300)
    if roscore_port is not None and rpc_port == roscore_port:
        problems.append(
            f"{master}: multimaster_rpc_port is {rpc_port}, which is also the port of its roscore; expected another port: "
            "leave it out for the port of the roscore + 300."
        )
    required = (
        "multimaster_roscore_port",
        "multimaster_roscore",
        "multimaster_filters",
        "multimaster_provider",
        "multimaster_routes",
    )
    required_of_each = (
        "multimaster_address",
        "multimaster_ros_setup",
        "multimaster_aliases",
        "multimaster_common_network",
    )
    if any(variable not in own for variable in required) or any(
        variable not in values[host] for host in hosts for variable in required_of_each
    ):
        return None  # already among the problems
    gateway = _read_gateway(hosts, values, own)
    computers = tuple(
        Computer(
            name=host,
            robot=name,
            address=values[host]["multimaster_address"],
            aliases=tuple(values[host]["multimaster_aliases"]),
            ros_setup=values[host]["multimaster_ros_setup"],
            common_address=_common_address(host, values[host]["multimaster_address"], gateway),
        )
        for host in hosts
    )
    return Robot(
        name=name,
        network=own.get("multimaster_network", values[hosts[0]]["multimaster_common_network"]),
        gateway=gateway,
        routes=own["multimaster_routes"],
        computers=computers,
        master=next(computer for computer in computers if computer.name == master),
        roscore=own["multimaster_roscore"],
        roscore_port=roscore_port,
        rpc_port=rpc_port,
        filters=own["multimaster_filters"],
        exports=own.get("multimaster_exports"),
        provider=own["multimaster_provider"],
    )


def _read_gateway(
    hosts: Sequence[str], values: Mapping[str, Mapping[str, Any]], own: Mapping[str, Any]
) -> Gateway | None:
    if not {"multimaster_network", "multimaster_gateway", "multimaster_common_address"} <= own.keys():
        return None  # in the common network, or already among the problems
    gateway = own["multimaster_gateway"]
    if gateway in hosts:
        return Gateway(gateway, values[gateway]["multimaster_address"], own["multimaster_common_address"])
    return Gateway("", gateway, own["multimaster_common_address"])


def _common_address(host: str, address: str, gateway: Gateway | None) -> str:
    if gateway is None:
        return address
    return gateway.common_address if host == gateway.name else ""


def _read_router(inventory: Inventory, shared: Mapping[str, Any], problems: list[str]) -> Router | None:
    given = shared.get("multimaster_router")
    if not inventory.routers:
        return Router("", given) if given else None
    name = inventory.routers[0]
    variables = inventory.variables.get(name, {})
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
    problems += _unknown(name, variables)
    address = variables.get("multimaster_address")
    variable = variables_module.BY_NAME["multimaster_address"]
    try:
        read = str(variable.read(address))
    except Unexpected as expected:
        found = "is not set" if address is None else f"is {_shown(address)}"
        problems.append(f"{name}: multimaster_address {found}; expected {expected}: set it in the inventory.")
        return None
    if given not in (None, read):
        problems.append(
            f"{name}: multimaster_address is {read}, but multimaster_router is {given}; expected one router: leave "
            "multimaster_router out where the group 'routers' has a host."
        )
    return Router(name, read)


def _party(
    name: str, hosts: Sequence[str], values: Mapping[str, Mapping[str, Any]], own: Mapping[str, Any]
) -> contradictions.Party:
    """A robot as far as it can be read; what its computers disagree about counts as not set."""
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


def _tenths(rate: float) -> int:
    """A heartbeat carries its rate in whole tenths."""
    return int(rate * 10)


def _offline_after(rate: float) -> float:
    """The default: two heartbeats at least. Who promises none is asked, and given up after 65 s (discovery_core.py)."""
    return max(5.0, math.ceil(200 / _tenths(rate)) / 10) if _tenths(rate) else 65.0


def _too_few_heartbeats(shared: Mapping[str, Any]) -> list[str]:
    """Silence is told from a slow rate by two heartbeats at least."""
    rate, after = shared.get("multimaster_heartbeat_hz"), shared.get("multimaster_offline_after")
    if rate is None or after is None:
        return []
    tenths = _tenths(rate)
    if tenths * after >= 20:
        return []
    longer = f" or multimaster_offline_after to {_offline_after(rate):g}" if tenths else ""
    return [
        f"multimaster_heartbeat_hz is {rate:g} and multimaster_offline_after is {after:g}, so a robot promises {tenths * after / 10:.2g} "
        f"heartbeats in that time; expected at least 2: raise multimaster_heartbeat_hz to {math.ceil(20 / after) / 10:g}{longer} "
        "in group_vars/robots.yml."
    ]


def _unreached_masters(robots: Sequence[Robot], shared: Mapping[str, Any]) -> list[str]:
    """Masters that no heartbeat can reach: multicast does not cross a gateway by itself (errata E4)."""
    group, routing = shared["multimaster_multicast_group"], shared["multimaster_multicast_routing"]
    if routing == "smcroute" and ipaddress.ip_address(group) in ipaddress.ip_network("224.0.0.0/24"):
        return [
            f"multimaster_multicast_group is {group}, which no router passes on (RFC 5771, 224.0.0.0/24), and "
            "multimaster_multicast_routing is 'smcroute'; expected a group outside 224.0.0.0/24: set it in group_vars/robots.yml, "
            "for example 239.255.0.1."
        ]
    if shared["multimaster_transport"] != "multicast" or len(robots) < 2:
        return []
    return [
        f"{robot.master.name}: is the master of the robot {robot.name} behind the gateway {robot.gateway.name or robot.gateway.address}, and "
        f"multimaster_transport is 'multicast'; expected a way to it, since nobody passes {group} on there: set multimaster_transport to "
        "'both'"
        + (" or multimaster_multicast_routing to 'smcroute'" if robot.gateway.name else "")
        + ", or choose the gateway as multimaster_master."
        for robot in robots
        if robot.gateway and not robot.master.common_address and (routing == "none" or not robot.gateway.name)
    ]


def _unique_names(computers: Sequence[tuple[str, Sequence[str]]]) -> list[str]:
    problems = []
    owner: dict[str, str] = {}
    for computer, names in computers:
        for name in names:
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
