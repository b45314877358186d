# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The members of the fleet, by their addresses, names and URIs of masters."""

from __future__ import annotations

from ipaddress import IPv4Address

from .._inventory.model import Computer, Fleet, Robot
from .model import KnownRobot, Membership


def make_membership(fleet: Fleet) -> Membership:
    """Return the members of the fleet: the robots of the inventory, its router, and the networks of multimaster_allow."""
    robots = [_make_robot(fleet, robot) for robot in fleet.robots]
    computers = [address for computer in fleet.computers for address in _addresses(computer)]
    if fleet.router and fleet.router.name:
        robots.append(KnownRobot(fleet.router.name, hosts=(fleet.router.name, str(fleet.router.address))))
        computers.append(fleet.router.address)
    return Membership(fleet.variables.strangers, fleet.variables.allow, tuple(robots), tuple(dict.fromkeys(computers)))


def ros_host(fleet: Fleet, computer: Computer) -> str:
    """Return the name or address of a computer in the URIs of its ROS nodes."""
    return computer.name if fleet.variables.advertise == "name" else str(computer.address)


def master_uri(fleet: Fleet, robot: Robot) -> str:
    """Return the URI of a robot's master, as its roscore says it."""
    return f"http://{ros_host(fleet, robot.master)}:{robot.variables.roscore_port}/"


def _make_robot(fleet: Fleet, robot: Robot) -> KnownRobot:
    """Return a robot as others know it. The URI of a roscore that something else started may have another of its names."""
    others = [f"http://{host}:{robot.variables.roscore_port}/" for host in _hosts(robot.master)]
    return KnownRobot(
        robot=robot.name,
        name=robot.master_name,
        uris=tuple(dict.fromkeys([master_uri(fleet, robot), *others])),
        rpc_port=robot.variables.rpc_port,
        addresses=_addresses(robot.companion),
        hosts=tuple(dict.fromkeys(host for computer in robot.computers for host in _hosts(computer))),
    )


def _addresses(computer: Computer) -> tuple[IPv4Address, ...]:
    """Return the planned addresses of a computer, the one that discovery uses first."""
    return tuple(dict.fromkeys([computer.discovery_address, computer.address]))


def _hosts(computer: Computer) -> list[str]:
    return [computer.name, *computer.variables.aliases, *map(str, _addresses(computer))]
