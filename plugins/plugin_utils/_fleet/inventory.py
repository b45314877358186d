# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""An inventory, and its values as far as they can be read: what the checks compare, before there is a model."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from ipaddress import IPv4Address
from typing import Any

from .exports import Export
from .kinds import SealedComputer
from .model import master_name
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


@dataclass(frozen=True)
class RobotValues:
    """A robot in the words of its variables. One that is not set, or cannot be read, is None."""

    name: str
    hosts: Sequence[str]
    own: RobotVariables
    raw: Values = field(default_factory=dict)  # the variables of its first host before they were read

    @property
    def seals(self) -> Mapping[str, SealedComputer]:
        """Its computers where Ansible does not log in."""
        return self.own.sealed or {}

    @property
    def computers(self) -> list[str]:
        """All of its computers."""
        return [*self.hosts, *self.seals]

    @property
    def has_sealed_master(self) -> bool:
        """True if its roscore is on a sealed computer."""
        return self.own.master in self.seals

    @property
    def master_name(self) -> str:
        """The name of its master; empty: not known."""
        master, port = self.own.master or self.hosts[0], self.own.roscore_port
        return master_name(master, port) if port and master in self.computers else ""

    @property
    def host(self) -> str:
        """The host with which sentences about the robot begin: that of its master, if it is one."""
        return next((host for host in self.hosts if host == self.own.master), self.hosts[0])

    @property
    def gateway_host(self) -> str | None:
        """The computer of the robot that is the gateway. None: the gateway is a device without a plan, or not known."""
        return next((host for host in self.hosts if host == self.own.gateway), None)

    @property
    def file(self) -> str:
        """The file with the variables of the robot."""
        return f"group_vars/{self.name}.yml"

    @property
    def filters(self) -> Mapping[str, Sequence[str]]:
        """What it takes from the others."""
        return self.own.filters or {}

    @property
    def entries(self) -> Sequence[Export]:
        """The entries of its declaration."""
        return self.own.exports or ()

    @property
    def inner_entries(self) -> list[Export]:
        """Those of them that do not cross by the border."""
        return [entry for entry in self.entries if not entry.crosses_border]

    def receivers(self, entry: Export, robots: Iterable[str]) -> list[str]:
        """Return the robots that get what an entry of its declaration names."""
        return [robot for robot in robots if robot != self.name and (not entry.to or robot in entry.to)]


@dataclass(frozen=True)
class InventoryValues:
    """The values of an inventory that are of their kinds. One that is not set, or cannot be read, is None."""

    inventory: Inventory
    hosts: Mapping[str, ComputerVariables]
    shared: FleetVariables  # what its hosts agree about, or the first of them has
    robots: Sequence[RobotValues]  # also those without hosts

    @property
    def seals(self) -> Mapping[str, SealedComputer]:
        """The sealed computers of all robots."""
        return {name: entry for robot in self.robots for name, entry in robot.seals.items()}

    @property
    def addresses(self) -> Mapping[str, IPv4Address]:
        """The address of each host and sealed computer."""
        sealed = {name: entry.address for name, entry in self.seals.items()}
        return sealed | {host: values.address for host, values in self.hosts.items() if values.address}
