# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Who belongs to the fleet, by what the network shows: addresses, names, and the URIs of masters."""

from __future__ import annotations

from ipaddress import IPv4Address

from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._fleet.model import Computer, Fleet, Robot, Router
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan.model import Belonging, KnownRobot


def belonging(fleet: Fleet) -> Belonging:
    """Return who belongs to the fleet: the robots of the inventory, its router, and who is allowed besides."""
    router = fleet.router if fleet.router is not None and fleet.router.name else None
    computers = [address for computer in fleet.computers for address in _addresses(computer)]
    return Belonging(
        strangers=fleet.variables.strangers,
        allow=fleet.variables.allow,
        robots=(*(_known(fleet, robot) for robot in fleet.robots), *([_known_router(router)] if router else [])),
        computers=tuple(dict.fromkeys([*computers, *([router.address] if router else [])])),
    )


def advertised(fleet: Fleet, computer: Computer) -> str:
    """Return what ROS on a computer calls it."""
    return computer.name if fleet.variables.advertise == "name" else str(computer.address)


def master_uri(fleet: Fleet, robot: Robot) -> str:
    """Return the URI of a robot's master, as its roscore says it."""
    return _uri(advertised(fleet, robot.master), robot)


def _uri(host: str, robot: Robot) -> str:
    return f"http://{host}:{robot.variables.roscore_port}/"


def _known(fleet: Fleet, robot: Robot) -> KnownRobot:
    """Return what is known of a robot. A roscore that something else started may call itself by another of its names."""
    others = [_uri(host, robot) for host in _hosts(robot.master)]
    return KnownRobot(
        robot=robot.name,
        name=robot.master_name,
        uris=tuple(dict.fromkeys([master_uri(fleet, robot), *others])),
        rpc_port=robot.variables.rpc_port,
        addresses=_addresses(robot.master),
        hosts=tuple(dict.fromkeys(host for computer in robot.computers for host in _hosts(computer))),
    )


def _known_router(router: Router) -> KnownRobot:
    return KnownRobot(robot=router.name, hosts=(router.name, str(router.address)))


def _addresses(computer: Computer) -> tuple[IPv4Address, ...]:
    """Return the planned addresses of a computer, the one that discovery uses first."""
    return tuple(dict.fromkeys([computer.discovery_address, computer.address]))


def _hosts(computer: Computer) -> list[str]:
    return [computer.name, *computer.variables.aliases, *map(str, _addresses(computer))]
