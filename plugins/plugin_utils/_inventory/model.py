# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""An inventory, and the fleet as types: robots, computers, networks. `read.read_fleet` makes the one of the other.

While an inventory is checked, a variable that is not set, or cannot be read, is None. So are values that follow from it. The fleet
that `read_fleet` returns has no such gaps.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from ipaddress import IPv4Address, IPv4Network
from typing import Any

from .exports import Export
from .flows import Flow, PlannedChannel, make_channels, make_flows
from .kinds import SealedComputer
from .variables import ComputerVariables, FleetVariables, RobotVariables

Values = Mapping[str, Any]  # by the names of their variables


@dataclass(frozen=True)
class Inventory:
    """The fleet's part of Ansible's inventory. `--limit` takes nothing out of it."""

    robots: Mapping[str, Sequence[str]]  # robot -> its hosts
    variables: Mapping[str, Values]  # host -> its multimaster_* variables
    strays: Sequence[str] = ()  # hosts of the robots' group outside its child groups
    routers: Sequence[str] = ()  # hosts of the group `routers`
    parts: Mapping[str, Mapping[str, Sequence[str]]] = field(
        default_factory=dict
    )  # robot -> its child groups -> their hosts

    @cached_property
    def hosts(self) -> list[str]:
        """Its hosts: the computers of the robots, and the routers."""
        return [*(host for hosts in self.robots.values() for host in hosts), *self.routers]

    def is_set(self, host: str, name: str) -> bool:
        """True if a host has a value of this variable, also one that cannot be read."""
        return self.variables.get(host, {}).get(f"multimaster_{name}") is not None


@dataclass(frozen=True)
class Computer:
    """One computer of a robot."""

    name: str
    robot: str
    common_address: IPv4Address | None  # its address in the common network; None behind a gateway
    variables: ComputerVariables
    sealed: bool = False  # Ansible does not log in there: it is no host of the inventory

    @property
    def address(self) -> IPv4Address:
        """The address by which the other computers reach it."""
        return self.variables.address

    @property
    def discovery_address(self) -> IPv4Address:
        """The address that discovery uses: the one in the common network, if there is one."""
        return self.common_address or self.address


@dataclass(frozen=True)
class Gateway:
    """A connection of a robot's own network with the common network."""

    name: str  # the computer; empty for a device outside the inventory
    address: IPv4Address  # in the robot's network
    common_address: IPv4Address

    @property
    def title(self) -> str:
        """The name, or the address of a device without one."""
        return self.name or str(self.address)


@dataclass(frozen=True)
class Router:
    """The device that manages the common network (section 4.1 of the report)."""

    name: str  # the host; empty for a device outside the inventory
    address: IPv4Address


@dataclass(frozen=True)
class Robot:
    """One robot: its computers, the one that runs its roscore, and the way out of its network."""

    name: str
    network: IPv4Network  # its own, or the common network
    computers: tuple[Computer, ...]  # the sealed ones are last
    variables: RobotVariables

    @cached_property
    def hosts(self) -> list[str]:
        """Its computers where Ansible logs in."""
        return [computer.name for computer in self.computers if not computer.sealed]

    @property
    def seals(self) -> Mapping[str, SealedComputer]:
        """Its computers where Ansible does not log in."""
        return self.variables.sealed or {}

    @cached_property
    def gateway(self) -> Gateway | None:
        """Its gateway. None in the common network."""
        own = self.variables
        if own.gateway is None or own.common_address is None:
            return None
        if isinstance(own.gateway, IPv4Address):
            return Gateway("", own.gateway, own.common_address)
        return Gateway(own.gateway, self._find(own.gateway).address, own.common_address)

    @cached_property
    def master(self) -> Computer:
        """The computer that runs its roscore."""
        return self._find(self.variables.master or self.hosts[0])

    @cached_property
    def companion(self) -> Computer:
        """The computer that runs discovery and sync: the master itself, unless that is sealed."""
        return self._find(self.variables.companion or self.hosts[0]) if self.master.sealed else self.master

    def _find(self, name: str) -> Computer:
        return next(computer for computer in self.computers if computer.name == name)

    @property
    def has_sealed_master(self) -> bool:
        """True if its roscore is on a sealed computer."""
        return self.variables.master in self.seals

    @property
    def master_name(self) -> str:
        """The name of its master: its computer, and the port if that is not 11311 (as upstream does). Empty: not known."""
        master, port = self.variables.master or self.hosts[0], self.variables.roscore_port
        if not port or master not in (*self.hosts, *self.seals):
            return ""
        return master.lower() if port == 11311 else f"{master.lower()}_{port}"

    # For the sentences about it

    @property
    def host(self) -> str:
        """The host with which sentences about the robot begin: that of its master, if it is one."""
        return next((host for host in self.hosts if host == self.variables.master), self.hosts[0])

    @property
    def gateway_host(self) -> str | None:
        """The computer of the robot that is the gateway. None: the gateway is a device without a plan, or not known."""
        return next((host for host in self.hosts if host == self.variables.gateway), None)

    @property
    def file(self) -> str:
        """The file with the variables of the robot."""
        return f"group_vars/{self.name}.yml"

    @property
    def filters(self) -> Mapping[str, Sequence[str]]:
        """Its filters of names that come from the others."""
        return self.variables.filters or {}

    @property
    def entries(self) -> Sequence[Export]:
        """The entries of its declaration."""
        return self.variables.exports or ()

    @property
    def inner_entries(self) -> list[Export]:
        """Those of them that do not cross by the relay."""
        return [entry for entry in self.entries if not entry.is_relayed]

    def receivers(self, entry: Export, robots: Iterable[str]) -> list[str]:
        """Return the robots that get the topics of an entry of its declaration."""
        return [robot for robot in robots if robot != self.name and (not entry.to or robot in entry.to)]


@dataclass(frozen=True)
class Overlay:
    """A network that programs on the computers make. It carries no multicast, and leads to each computer and the network behind it."""

    hub: Computer | None = None  # it passes packets on between others


@dataclass(frozen=True)
class Fleet:
    """All robots and their common values."""

    robots: tuple[Robot, ...]
    router: Router | None
    variables: FleetVariables
    overlay: Overlay | None = None  # the common network, if an optional feature makes it
    multicast_routing: str = "none"  # the program that passes the group on at gateways, if an optional feature does

    @property
    def computers(self) -> tuple[Computer, ...]:
        """The computers of all robots, in the order of the inventory."""
        return tuple(computer for robot in self.robots for computer in robot.computers)

    @cached_property
    def addresses(self) -> Mapping[str, IPv4Address]:
        """The address of each computer. If a host has the name of a sealed one, it counts."""
        computers = sorted(self.computers, key=lambda computer: not computer.sealed)
        return {computer.name: computer.address for computer in computers if computer.address}

    @cached_property
    def named(self) -> Mapping[str, Computer]:
        """Its computers by their names. The name of a robot means the computer of its master."""
        masters = {robot.name: robot.master for robot in self.robots}
        return {**masters, **{computer.name: computer for computer in self.computers}}

    @cached_property
    def flows(self) -> tuple[Flow, ...]:
        """The declared data flows. A robot without a declaration gives everything to every robot."""
        return make_flows({robot.name: robot.variables.exports for robot in self.robots})

    @cached_property
    def channels(self) -> tuple[PlannedChannel, ...]:
        """The channels by the relays of the robots."""
        return make_channels({robot.name: robot.variables.exports for robot in self.robots})

    @cached_property
    def has_exports(self) -> bool:
        """True if any robot declares its exports."""
        return any(robot.variables.exports is not None for robot in self.robots)
