# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Whether the addresses and networks of an inventory can be routed (section 4.1 of the report).

Pure: addresses and networks in, sentences out. What is missing is not judged twice.
"""

from __future__ import annotations

import ipaddress
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Layout:
    """What a robot's variables say of its network; empty texts for what is not set."""

    hosts: Sequence[str]
    network: str
    gateway: str
    common_address: str
    unread: frozenset[str] = frozenset()  # variables with a value that is not of its kind

    @classmethod
    def of(cls, hosts: Sequence[str], own: Mapping[str, Any], given: Mapping[str, Any]) -> Layout:
        """The layout in the variables of a robot, as they were read and as they were given."""
        names = ("multimaster_network", "multimaster_gateway", "multimaster_common_address")
        unread = frozenset(name for name in names if given.get(name) is not None and name not in own)
        return cls(hosts, *(own.get(name, "") for name in names), unread)


def problems(
    common: str,
    addresses: Mapping[str, str],
    robots: Mapping[str, Layout],
    router: tuple[str, str] | None,
) -> list[str]:
    """What keeps packets from going everywhere and back, one sentence each.

    `common` is the common network (empty: unknown), `addresses` has the address of each host, `router` is the host (or an
    empty text) and the address of the device that manages the common network.
    """
    found = []
    for robot, layout in robots.items():
        found += _complete(robot, layout)
        found += _members(layout, common, addresses)
        found += _gateway(robot, layout, common, addresses)
    found += _overlaps(common, robots)
    found += _unique(addresses, robots, router)
    if router and common:
        found += _inside(
            router[0] or "The router", "multimaster_address" if router[0] else "multimaster_router", router[1], common
        )
    return found


def _complete(robot: str, layout: Layout) -> Iterator[str]:
    """The three variables of a robot's own network belong together."""
    given = {
        "multimaster_network": layout.network,
        "multimaster_gateway": layout.gateway,
        "multimaster_common_address": layout.common_address,
    }
    examples = {
        "multimaster_network": "the robot's own network, such as 192.168.11.0/24",
        "multimaster_gateway": "the computer of the robot that connects it with the common network"
        + (f", one of {', '.join(layout.hosts)}" if layout.hosts else ""),
        "multimaster_common_address": "the gateway's address in the common network, such as 192.168.1.201",
    }
    present = [name for name, value in given.items() if value]
    if layout.hosts and present:
        for name, value in given.items():
            if not value and name not in layout.unread:
                yield (
                    f"{layout.hosts[0]}: {name} of the robot {robot} is not set, but {present[0]} is; expected {examples[name]}: "
                    f"set it in group_vars/{robot}.yml."
                )


def _members(layout: Layout, common: str, addresses: Mapping[str, str]) -> Iterator[str]:
    """Every computer is in the network of its robot."""
    if not layout.network and (layout.gateway or layout.common_address):
        return  # among the incomplete ones already
    network, variable = (
        (layout.network, "multimaster_network") if layout.network else (common, "multimaster_common_network")
    )
    for host in layout.hosts:
        if network and host in addresses:
            yield from _inside(host, "multimaster_address", addresses[host], network, variable)


def _gateway(robot: str, layout: Layout, common: str, addresses: Mapping[str, str]) -> Iterator[str]:
    """The gateway is in both networks."""
    where = f"group_vars/{robot}.yml"
    if layout.gateway and layout.gateway not in layout.hosts:
        if not layout.gateway.replace(".", "").isdigit():
            yield (
                f"{layout.hosts[0]}: multimaster_gateway of the robot {robot} is '{layout.gateway}', which is none of its computers; "
                f"expected one of {', '.join(layout.hosts)}, or the address of another device: correct it in {where}."
            )
        elif layout.gateway in addresses.values():
            host = {address: host for host, address in addresses.items()}[layout.gateway]
            yield (
                f"{layout.hosts[0]}: multimaster_gateway of the robot {robot} is {layout.gateway}, the address of {host}; expected the "
                f"name of a computer of the inventory: write {host} in {where}."
            )
        elif layout.network:
            yield from _inside(
                layout.hosts[0], "multimaster_gateway", layout.gateway, layout.network, "multimaster_network"
            )
    if layout.common_address and common and layout.hosts:
        host = layout.gateway if layout.gateway in layout.hosts else layout.hosts[0]
        yield from _inside(host, "multimaster_common_address", layout.common_address, common)


def _inside(
    host: str, variable: str, address: str, network: str, of: str = "multimaster_common_network"
) -> Iterator[str]:
    inside, of_one = ipaddress.ip_network(network), ipaddress.ip_address(address)
    if of_one not in inside:
        yield (
            f"{host}: {variable} is {address}, which is outside {of} {network}; expected an address of that network: correct one of "
            "the two."
        )
    elif inside.prefixlen < 31 and of_one in (inside.network_address, inside.broadcast_address):
        yield (
            f"{host}: {variable} is {address}, which is the network's or the broadcast address of {network}; expected the address of "
            "one computer: correct it."
        )


def _overlaps(common: str, robots: Mapping[str, Layout]) -> Iterator[str]:
    """No address may be in two networks. Sorted by their begin, only neighbours can overlap first."""
    named = [
        (ipaddress.ip_network(layout.network), f"multimaster_network of the robot {robot}")
        for robot, layout in robots.items()
        if layout.network
    ]
    if common:
        named.append((ipaddress.ip_network(common), "multimaster_common_network"))
    named.sort(key=lambda entry: (entry[0].network_address, entry[0].prefixlen))
    widest, whose = named[0] if named else (None, "")
    for network, name in named[1:]:
        if network.overlaps(widest):
            yield (
                f"{name} is {network}, and {whose} is {widest}: they overlap; expected networks without a common address, since a packet "
                "has one way: change one of the two."
            )
        if network.broadcast_address > widest.broadcast_address:
            widest, whose = network, name


def _unique(
    addresses: Mapping[str, str], robots: Mapping[str, Layout], router: tuple[str, str] | None
) -> Iterator[str]:
    """Every address belongs to one."""
    claims = [(host, "multimaster_address", address) for host, address in addresses.items()]
    for robot, layout in robots.items():
        if layout.common_address and layout.hosts:
            host = layout.gateway if layout.gateway in layout.hosts else f"the gateway of {robot}"
            claims.append((host, "multimaster_common_address", layout.common_address))
    if router:
        claims.append(
            (router[0] or "the router", "multimaster_address" if router[0] else "multimaster_router", router[1])
        )
    owner: dict[str, str] = {}
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
