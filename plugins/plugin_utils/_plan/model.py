# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The plan of a fleet as types: FleetPlan for all computers, ComputerPlan for one.

`plain.to_plain` makes Ansible's variables `multimaster_fleet` and `multimaster_plan` of it. A field here is a key there,
in the same order. `plain.from_plain` reads them again. Only actions, filters and lookups call these two.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from ipaddress import IPv4Address, IPv4Network
from typing import Any, ClassVar

from .._base.features import FeaturePart, load_hooks
from .._base.plain import notation
from .._inventory.model import Gateway, Router

DEFAULT_ROUTE = IPv4Network("0.0.0.0/0")
COMMON = "the common network"
# The interfaces of a computer on the common network, and on that of its robot.
COMMON_INTERFACE, OWN_INTERFACE = "{common}", "{own}"

# Parameters of a node, in the words of the provider. The services get them as JSON.
Parameters = Mapping[str, Any]


# The common values of all computers


@dataclass(frozen=True)
class HostsEntry:
    """A line of /etc/hosts: an address and its names, the name in the inventory first."""

    address: IPv4Address
    names: tuple[str, ...]


@dataclass(frozen=True)
class Master:
    """A ROS master as every discovery node is expected to list it."""

    robot: str
    computer: str
    address: IPv4Address  # that discovery uses: on a gateway the one in the common network
    name: str
    uri: str
    monitor_uri: str
    rpc_port: int
    declared: bool = False  # the robot declares its exports
    # The address of its roscore, if that is on a sealed computer: then `computer` is the companion.
    roscore: IPv4Address | None = field(default=None, metadata=notation(left_out=True))


@dataclass(frozen=True)
class PlannedFlow:
    """Topics, services and parameters that each of `givers` gives to each of `to`."""

    givers: tuple[str, ...] = field(metadata=notation(key="from"))
    to: tuple[str, ...]
    topics: tuple[str, ...] = ()
    services: tuple[str, ...] = ()
    parameters: tuple[str, ...] | None = field(default=None, metadata=notation(left_out=True))


@dataclass(frozen=True)
class RobotNetwork:
    """The own network of a robot, and its gateway to the common network."""

    robot: str
    network: IPv4Network
    gateway: IPv4Address  # in this network
    common_address: IPv4Address  # of the gateway, in the common network
    device: bool = False  # the gateway is no computer of the inventory


@dataclass(frozen=True)
class Member:
    """A computer of a robot as the other computers see it."""

    name: str
    robot: str
    address: IPv4Address
    network: IPv4Network
    discovery_address: IPv4Address
    discovery: bool  # it takes part in the traffic of discovery
    multicast: bool  # it hears the multicast group of the others


@dataclass(frozen=True)
class KnownRobot:
    """The names and addresses of a robot in the network. The router has an entry without a master."""

    robot: str
    name: str = ""  # of its master
    uris: tuple[str, ...] = ()  # of its master: the planned one, and those with its other names and addresses
    rpc_port: int = 0
    addresses: tuple[IPv4Address, ...] = ()  # of its master's computer; discovery uses the first
    hosts: tuple[str, ...] = ()  # names and addresses of all its computers


@dataclass(frozen=True)
class Membership:
    """The members of the fleet."""

    strangers: str = "ignore"  # or allow: for masters outside the inventory
    allow: tuple[IPv4Network, ...] = ()  # computers outside the inventory that are members too
    robots: tuple[KnownRobot, ...] = ()
    computers: tuple[IPv4Address, ...] = ()  # all addresses of all computers and of the router


@dataclass(frozen=True)
class Listener:
    """A computer that measures the datagrams of the others, as the module multicast_verify takes it."""

    name: str
    address: IPv4Address  # that discovery uses
    multicast: bool  # it hears the multicast group of the others


# The values of one computer


@dataclass(frozen=True)
class PlannedInterface:
    """An interface that a program makes, such as that of a tunnel; it is not there before the first run."""

    name: str
    address: IPv4Address
    network: IPv4Network
    mtu: int


class PlanPart(FeaturePart):
    """The part of an optional feature in the plan of a computer, with its effects on the rest of the plan."""

    carries: ClassVar[str] = (
        ""  # its name in a picture, if it makes the common network: its program makes the routes there
    )

    passes_group: ClassVar[bool] = False  # the computer passes multicast to the group on by it

    @property
    def duty(self) -> str:
        """The service of the computer for others by it, in a word for a picture; empty without such a service."""
        return ""

    @property
    def forwards(self) -> bool:
        """True if the computer passes packets of other computers on by it."""
        return False

    @property
    def services(self) -> tuple[str, ...]:
        """The services that start before all others of the computer."""
        return ()

    @property
    def own_services(self) -> tuple[str, ...]:
        """The services that its role starts."""
        return ()

    @property
    def open_ports(self) -> tuple[str, ...]:
        """The ports that it opens to everybody, as the packet filter has them."""
        return ()

    @property
    def interface(self) -> PlannedInterface | None:
        """The interface that it makes."""
        return None

    def list_ways(self) -> Mapping[IPv4Network, IPv4Address]:
        """Return the next address to each network to which its own program leads."""
        return {}


@dataclass(frozen=True)
class PlannedAddress:
    """An address of the computer, and the network that its interface is in."""

    network: IPv4Network
    address: IPv4Address


@dataclass(frozen=True)
class Setting:
    """A kernel parameter (sysctl). `{common}` in a name is the interface on the common network, see preflight."""

    name: str
    value: str
    # Values that serve as well. A foreign file may keep them.
    enough: tuple[str, ...] | None = field(default=None, metadata=notation(left_out=True))


@dataclass(frozen=True)
class PlannedRoute:
    """A route that the computer needs."""

    destination: IPv4Network = field(metadata=notation(words=((DEFAULT_ROUTE, "default"),)))
    gateway: IPv4Address


@dataclass(frozen=True)
class ExpectedRoute:
    """A route that something else makes, by one of the gateways."""

    destination: IPv4Network
    gateways: tuple[IPv4Address, ...]


@dataclass(frozen=True)
class NodeProgram:
    """A ROS node to look for: its package, its executable, and the Python modules that it imports."""

    package: str
    executable: str
    modules: tuple[str, ...]
    programs: tuple[str, ...] = ()  # further programs that it uses
    environment: Mapping[str, str] = field(default_factory=dict)  # the variables that it needs and the ROS does not set


@dataclass(frozen=True)
class LookAt:
    """The options of multimaster_info for this computer."""

    parts: tuple[str, ...] = ()
    destinations: tuple[IPv4Address, ...] = ()
    packages: tuple[str, ...] = ()
    nodes: tuple[NodeProgram, ...] = ()
    folders: tuple[str, ...] | None = field(default=None, metadata=notation(left_out=True))


@dataclass(frozen=True)
class PlannedGuard:
    """Networks whose addresses come in at one interface only. Its name is COMMON_INTERFACE or OWN_INTERFACE until preflight knows it."""

    networks: tuple[IPv4Network, ...]
    interface: str


@dataclass(frozen=True)
class Firewall:
    """The packet filter of a computer. FleetPlan.let_in has the sources that pass it."""

    networks: tuple[IPv4Network, ...] = ()  # behind the computer, and protected by it too
    guards: tuple[PlannedGuard, ...] = ()
    also: tuple[IPv4Network, ...] = ()  # sources that pass only on this computer
    open_ports: tuple[str, ...] = ()  # open to everybody


@dataclass(frozen=True)
class Port:
    """A port that a service of the collection listens on."""

    protocol: str  # tcp or udp
    port: int


@dataclass(frozen=True)
class UnitLines:
    """The lines of a systemd unit that differ by provider: the last of its [Unit] and of its [Service]."""

    unit: str = ""
    service: str = ""


def _list_parts() -> Mapping[str, type]:
    """Return the keys that features have in the plan of a computer, with their types."""
    return load_hooks("model", type)


def _list_due() -> Mapping[str, type]:
    return {f"{name}_due": bool for name in load_hooks("model", type)}


@dataclass(frozen=True, kw_only=True)
class ComputerPlan:
    """The configuration of one computer, or of the router of the common network."""

    computer: str
    robot: str = ""  # empty for the router
    address: IPv4Address
    common_address: IPv4Address | None = None  # None behind a gateway
    network: IPv4Network
    networks: tuple[PlannedAddress, ...] = ()
    is_master: bool = False  # it runs discovery and sync of its robot: the master, or its companion
    is_gateway: bool = False
    is_router: bool = False
    roscore: str = "managed"  # or existing, or sealed: on another computer, without a login for people
    roscore_port: int = 0
    ros_setup: str = "auto"
    shells: str = "all"  # or names, or nothing: the part of the environment that shells get
    sysctl: tuple[Setting, ...] = ()
    routes: tuple[PlannedRoute, ...] = ()
    routes_expected: tuple[ExpectedRoute, ...] = ()
    look_at: LookAt = LookAt()
    firewall: Firewall | None = None  # None: no packet filter is wanted
    features: Mapping[str, PlanPart] = field(default_factory=dict, metadata=notation(among=_list_parts))
    environment: Mapping[str, str] = field(default_factory=dict)
    ports: tuple[Port, ...] = ()
    services: tuple[str, ...] = ()  # in the order in which they start
    provider: str = "bundled"
    discovery: Parameters = field(default_factory=dict)
    sync: Parameters = field(default_factory=dict)
    # Of master_relay, if one is needed.
    relay: Parameters | None = field(default=None, metadata=notation(left_out=True))
    # The folder of node_exporter for the metrics of the nodes. None: the nodes write no metrics.
    metrics_folder: str | None = field(default=None, metadata=notation(left_out=True))
    # Parameters that its robot gives to others, or gets of them. Only a master has some.
    crossing: tuple[str, ...] | None = field(default=None, metadata=notation(left_out=True))
    limits: tuple[str, ...] = ()  # a sentence for each thing that the provider cannot do
    listens: bool = False  # it is one of the listeners
    # Ansible does not log in there, so nothing of this plan is applied or looked at.
    sealed: bool | None = field(default=None, metadata=notation(left_out=True))
    # Preflight fills these in, since it knows the machine.
    programs: Mapping[str, UnitLines] | None = field(default=None, metadata=notation(left_out=True))
    packages: tuple[str, ...] | None = field(default=None, metadata=notation(left_out=True))
    # A packet filter is planned, or an earlier plan left one behind.
    firewall_due: bool | None = field(default=None, metadata=notation(left_out=True))
    nft_missing: bool | None = field(
        default=None, metadata=notation(left_out=True)
    )  # it is needed, and to be installed first
    features_due: Mapping[str, bool] = field(
        default_factory=dict, metadata=notation(among=_list_due)
    )  # the same of each feature

    @property
    def carrier(self) -> str:
        """The name of the feature that makes the common network here; empty if no feature makes it."""
        return next((part.carries for part in self.features.values() if part.carries), "")

    @property
    def interfaces_to_come(self) -> tuple[PlannedInterface, ...]:
        """The interfaces that its features make."""
        return tuple(part.interface for part in self.features.values() if part.interface)

    @property
    def forwards(self) -> bool:
        """True if it passes packets of other computers on."""
        return self.is_gateway or self.is_router or any(part.forwards for part in self.features.values())

    @property
    def all_services(self) -> tuple[str, ...]:
        """The services that are to run, with those that the roles of features start."""
        return (*self.services, *(name for part in self.features.values() for name in part.own_services))

    @property
    def passes_group(self) -> bool:
        """True if it passes multicast to the group on."""
        return any(part.passes_group for part in self.features.values())


@dataclass(frozen=True, kw_only=True)
class FleetPlan:
    """The plan of the fleet: the common values, and one entry for each computer.

    Lists that every computer needs are here once, so the plan grows with the number of computers.
    """

    hosts_entries: tuple[HostsEntry, ...] = ()
    masters: tuple[Master, ...] = ()
    flows: tuple[PlannedFlow, ...] = ()
    common_network: IPv4Network
    networks: tuple[RobotNetwork, ...] = ()
    router: Router | None = None
    transport: str = "both"
    multicast_group: IPv4Address = IPv4Address("226.0.0.0")
    multicast_port: int = 11511
    multicast_routing: str = "none"
    members: tuple[Member, ...] = ()
    listeners: tuple[Listener, ...] = ()
    let_in: tuple[IPv4Network, ...] = ()  # sources that pass the packet filters; empty without them
    belonging: Membership = Membership()
    computers: Mapping[str, ComputerPlan] = field(default_factory=dict)

    @cached_property
    def master_of(self) -> Mapping[str, Master]:
        """The master of each robot, by the robot's name."""
        return {master.robot: master for master in self.masters}

    @cached_property
    def master_uris(self) -> Mapping[str, tuple[str, ...]]:
        """The URIs that the master of each robot may have, the planned one first. A sealed one may have each of its names."""
        names = {known.robot: known.uris for known in self.belonging.robots}
        return {
            master.robot: tuple(dict.fromkeys([master.uri, *(names.get(master.robot, ()) if master.roscore else ())]))
            for master in self.masters
        }

    @cached_property
    def network_names(self) -> Mapping[IPv4Network, str]:
        """The name of each planned network, the common one first."""
        return {
            self.common_network: COMMON,
            **{entry.network: f"the network of {entry.robot}" for entry in self.networks},
        }

    @cached_property
    def companions(self) -> Mapping[str, str]:
        """The sealed computer with the roscore of each companion, by the companion."""
        sealed = {plan.address: name for name, plan in self.computers.items() if plan.sealed}
        return {master.computer: sealed[master.roscore] for master in self.masters if master.roscore in sealed}

    @cached_property
    def gateways(self) -> Mapping[str, Gateway]:
        """The gateway of each robot that has a network of its own, by the robot's name."""
        names = {plan.robot: name for name, plan in self.computers.items() if plan.is_gateway}
        return {
            entry.robot: Gateway(names.get(entry.robot, ""), entry.gateway, entry.common_address)
            for entry in self.networks
        }

    def talkers_by_robot(self, talkers: Collection[str]) -> dict[str, list[str]]:
        """Return the computers of `talkers` that each robot is to hear. The empty name is the router.

        A robot hears its givers: itself, the robots with a flow to it, and those that declare nothing.
        """
        open_robots = {master.robot for master in self.masters if not master.declared}
        by_robot = {}
        for robot in ("", *self.master_of):
            givers = {giver for flow in self.flows if robot in flow.to for giver in flow.givers} | open_robots | {robot}
            by_robot[robot] = [
                member.name for member in self.members if member.robot in givers and member.name in talkers
            ]
        return by_robot
