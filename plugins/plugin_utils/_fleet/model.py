# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The fleet as types: robots, computers, networks. `read.read_fleet` makes it of an inventory."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from ipaddress import IPv4Address, IPv4Network

from .flows import Channel, Flow, make_channels, make_flows
from .variables import ComputerVariables, FleetVariables, RobotVariables


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
        """The address that discovery uses: the one in the common network, where there is one."""
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
    gateway: Gateway | None  # None in the common network
    computers: tuple[Computer, ...]  # the sealed ones are last
    master: Computer
    companion: Computer  # it runs discovery and sync: the master itself, unless that is sealed
    variables: RobotVariables

    @property
    def master_name(self) -> str:
        """The name of its master."""
        return master_name(self.master.name, self.variables.roscore_port)


def master_name(computer: str, roscore_port: int) -> str:
    """Return the name of a master: its computer, and the port where that is not 11311 (as upstream does)."""
    return computer.lower() if roscore_port == 11311 else f"{computer.lower()}_{roscore_port}"


@dataclass(frozen=True)
class Fleet:
    """All robots and what they share."""

    robots: tuple[Robot, ...]
    router: Router | None
    variables: FleetVariables

    @property
    def computers(self) -> tuple[Computer, ...]:
        """The computers of all robots, in the order of the inventory."""
        return tuple(computer for robot in self.robots for computer in robot.computers)

    @cached_property
    def clock(self) -> Computer | None:
        """The source of the fleet's time. None without one, and for a name that no computer or robot has."""
        names = {computer.name: computer for computer in self.computers}
        masters = {robot.name: robot.master for robot in self.robots}
        return {**masters, **names}.get(self.variables.clock or "")

    @cached_property
    def hub(self) -> Computer | None:
        """The computer through which the tunnel reaches those without an endpoint. None without one, and for a name that no computer has."""
        name = self.variables.tunnel_hub if self.variables.tunnel != "none" else None
        return next((computer for computer in self.computers if computer.name == name), None)

    @cached_property
    def flows(self) -> tuple[Flow, ...]:
        """The declared data flows. A robot without a declaration gives everything to every robot."""
        return make_flows({robot.name: robot.variables.exports for robot in self.robots})

    @cached_property
    def channels(self) -> tuple[Channel, ...]:
        """The channels by the borders of the robots."""
        return make_channels({robot.name: robot.variables.exports for robot in self.robots})

    @cached_property
    def has_exports(self) -> bool:
        """True if any robot declares what it gives."""
        return any(robot.variables.exports is not None for robot in self.robots)
