# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Checks whether the addresses and networks of an inventory can be routed (section 4.1 of the report).

Addresses and networks in, sentences out. A missing value is one sentence.
"""

from __future__ import annotations

from collections.abc import Container, Iterator, Mapping
from ipaddress import IPv4Address, IPv4Network
from typing import Any

from .._base.features import load_hooks
from .hooks import InventoryHooks
from .model import Fleet, Inventory, Robot, Router

# The variables of a robot's own network, and the value that each is expected to have.
_EXAMPLES = {
    "network": "the robot's own network, such as 192.168.11.0/24",
    "gateway": "the computer of the robot that connects it with the common network, one of {hosts}",
    "common_address": "the gateway's address in the common network, such as 192.168.1.201",
}


def find_network_problems(fleet: Fleet, inventory: Inventory) -> list[str]:
    """Return the reasons why packets cannot go everywhere and back, one sentence each."""
    common, addresses, router = fleet.variables.common_network, fleet.addresses, fleet.router
    hosts = {address: host for host, address in addresses.items()}
    problems: list[str] = []
    for robot in fleet.robots:
        problems += _check_completeness(robot, inventory)
        problems += _check_members(robot, common, addresses)
        problems += _check_gateway(robot, common, hosts)
    problems += _check_overlaps(fleet)
    problems += _check_uniqueness(fleet)
    if router and common:
        problems += _check_address(router.name or "The router", _variable_of(router), router.address, common)
    return problems


def _variable_of(router: Router) -> str:
    return "multimaster_address" if router.name else "multimaster_router"


def _check_completeness(robot: Robot, inventory: Inventory) -> Iterator[str]:
    """Check that all three variables of a robot's own network are set, or that all are missing."""
    present = [name for name in _EXAMPLES if getattr(robot.variables, name)]
    for name, example in _EXAMPLES.items() if robot.hosts and present else ():
        if not getattr(robot.variables, name) and not inventory.is_set(robot.hosts[0], name):
            yield (
                f"{robot.hosts[0]}: multimaster_{name} of the robot {robot.name} is not set, but multimaster_{present[0]} is; expected "
                f"{example.format(hosts=', '.join(robot.hosts))}: set it in {robot.file}."
            )


def _check_members(robot: Robot, common: IPv4Network | None, addresses: Mapping[str, IPv4Address]) -> Iterator[str]:
    """Check that every computer is in the network of its robot."""
    own = robot.variables
    if not own.network and (own.gateway or own.common_address):
        return  # _check_completeness has a sentence for it
    network, variable = (own.network, "multimaster_network") if own.network else (common, "multimaster_common_network")
    for host in (*robot.hosts, *robot.seals):
        if network and host in addresses:
            yield from _check_address(host, _address_variable(host, robot.seals), addresses[host], network, variable)


def _address_variable(host: str, seals: Container[str]) -> str:
    """Name the variable with the address of a computer."""
    return "multimaster_sealed" if host in seals else "multimaster_address"


def _check_gateway(robot: Robot, common: IPv4Network | None, named: Mapping[Any, str]) -> Iterator[str]:
    """Check that the gateway is in both networks; `named` has the computer at each address."""
    own, gateway = robot.variables, robot.variables.gateway
    if gateway in robot.seals or named.get(gateway) in robot.seals:
        return  # contradictions has a sentence for it
    if isinstance(gateway, str) and not robot.gateway_host:
        yield (
            f"{robot.hosts[0]}: multimaster_gateway of the robot {robot.name} is '{gateway}', which is not one of its computers; "
            f"expected one of {', '.join(robot.hosts)}, or the address of another device: correct it in {robot.file}."
        )
    elif gateway in named:
        host = named[gateway]
        yield (
            f"{robot.hosts[0]}: multimaster_gateway of the robot {robot.name} is {gateway}, the address of {host}; expected the "
            f"name of a computer of the inventory: write {host} in {robot.file}."
        )
    elif isinstance(gateway, IPv4Address) and own.network:
        yield from _check_address(robot.hosts[0], "multimaster_gateway", gateway, own.network, "multimaster_network")
    if own.common_address and common:
        host = robot.gateway_host or robot.hosts[0]
        yield from _check_address(host, "multimaster_common_address", own.common_address, common)


def _check_address(
    host: str, variable: str, address: IPv4Address, network: IPv4Network, source: str = "multimaster_common_network"
) -> Iterator[str]:
    """Check that an address is one of the network that the variable `source` has."""
    if address not in network:
        yield (
            f"{host}: {variable} is {address}, which is outside {source} {network}; expected an address of that network: correct one of "
            "the two."
        )
    elif network.prefixlen < 31 and address in (network.network_address, network.broadcast_address):
        yield (
            f"{host}: {variable} is {address}, which is the network's or the broadcast address of {network}; expected the address of "
            "one computer: correct it."
        )


def _check_overlaps(fleet: Fleet) -> Iterator[str]:
    """Check that no address is in two networks. Sorted by their begin, each is compared with the widest one before it."""
    shared = fleet.variables
    named = [(robot.variables.network, f"multimaster_network of the robot {robot.name}") for robot in fleet.robots]
    named += [
        (shared.common_network, "multimaster_common_network"),
    ]
    for hooks in load_hooks("inventory", InventoryHooks).values():
        named += hooks.list_networks(shared)
    names = [(network, name) for network, name in named if network]
    names.sort(key=lambda entry: (entry[0].network_address, entry[0].prefixlen))
    if not names:
        return
    widest, whose = names[0]
    for network, name in names[1:]:
        if network.overlaps(widest):
            yield (
                f"{name} is {network}, and {whose} is {widest}: they overlap; expected networks without a common address, since a packet "
                "has one way: change one of the two."
            )
        if network.broadcast_address > widest.broadcast_address:
            widest, whose = network, name


def _check_uniqueness(fleet: Fleet) -> Iterator[str]:
    """Check that every address belongs to one computer."""
    addresses, router = fleet.addresses, fleet.router
    seals = {computer.name for computer in fleet.computers if computer.sealed}
    claims = [(host, _address_variable(host, seals), address) for host, address in addresses.items()]
    for robot in fleet.robots:
        if robot.variables.common_address:
            host = robot.gateway_host or f"the gateway of {robot.name}"
            claims.append((host, "multimaster_common_address", robot.variables.common_address))
    if router:
        claims.append((router.name or "the router", _variable_of(router), router.address))
    owner: dict[IPv4Address, str] = {}
    for host, variable, address in claims:
        first = owner.setdefault(address, host)
        if first != host:
            yield (
                f"{host}: {variable} is {address}, which {first} has too; expected an address of its own: correct one of the two."
            )
        elif variable == "multimaster_common_address" and addresses.get(host) == address:
            yield (
                f"{host}: multimaster_common_address is {address}, which is its multimaster_address too; expected its address in the "
                "common network here, and the one in the robot's network there: correct one of the two."
            )
