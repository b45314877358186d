# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The tunnel in the plan of a computer: its peers, and the sentence of preflight if a machine cannot have it.

Pure: the fleet and a description of the machine in, a plan and sentences out.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from ipaddress import IPv4Address, IPv4Network
from typing import Any

from ..._base.plain_text import quote
from ..._inventory.model import Computer, Fleet, Robot
from ..._plan.hooks import PlanHooks
from ..._plan.model import ComputerPlan
from ..._plan.plan import list_behind, list_network_routes
from .model import INTERFACE, PlannedPeer, Tunnel
from .variables import EndpointVariables, TunnelVariables


def make_tunnel(fleet: Fleet, robot: Robot, computer: Computer) -> Tunnel | None:
    """Return the place of a computer in the tunnel, None without one. Computers behind a gateway use that of the gateway."""
    given = TunnelVariables.read(fleet.variables)
    if given.tunnel == "none" or computer.common_address is None:
        return None
    return Tunnel(
        computer=computer.name,
        address=computer.common_address,
        network=fleet.variables.common_network,
        port=given.tunnel_port,
        peers=tuple(_list_peers(fleet, computer)),
        routes=list_network_routes(fleet, robot, computer),
        hub=computer == _find_hub(fleet) or None,
    )


def _list_peers(fleet: Fleet, computer: Computer) -> Iterator[PlannedPeer]:
    """Yield the peers of a computer. If there is a hub, all between others of which one has no endpoint goes through it."""
    others = [
        (own, (IPv4Network(own.discovery_address), *list_behind(robot, own)))  # its own addresses in the tunnel
        for robot in fleet.robots
        for own in robot.computers
        if own.common_address and own != computer
    ]
    by_hub = [own for own, _networks in others if _is_reached_by_hub(fleet, computer, own)]
    behind = [network for own, networks in others if own in by_hub for network in networks]
    for own, networks in others:
        if own not in by_hub:
            yield PlannedPeer(own.name, (*networks, *(behind if own == _find_hub(fleet) else ())), _find_endpoint(own))


def _is_reached_by_hub(fleet: Fleet, one: Computer, other: Computer) -> bool:
    return _find_hub(fleet) not in (None, one, other) and None in (_find_endpoint(one), _find_endpoint(other))


def _find_hub(fleet: Fleet) -> Computer | None:
    return fleet.overlay.hub if fleet.overlay else None


def _find_endpoint(computer: Computer) -> IPv4Address | None:
    return EndpointVariables.read(computer.variables).endpoint


# The machine


def list_tunnel_packages(plan: ComputerPlan, info: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the packages that the tunnel needs."""
    if Tunnel.find(plan) is None:
        return ()
    return ("wireguard-tools", *(() if info["tunnel"]["kernel"] else ("wireguard-go",)))


def find_tunnel_problems(plan: ComputerPlan, info: Mapping[str, Any]) -> Iterator[str]:
    """Yield a sentence for a foreign tunnel with the same address, and for a machine that can have no tunnel."""
    tunnel = Tunnel.find(plan)
    if tunnel is None:
        return
    places = [(of["name"], entry) for of in info["interfaces"] for entry in of["addresses"]]
    found = [name for name, entry in places if entry["address"] == str(tunnel.address) and name != INTERFACE]
    if found:
        there = ", ".join(map(quote, dict.fromkeys(found)))
        yield (
            f"{plan.computer}: {tunnel.address} is already on {there}, and multimaster_tunnel is 'wireguard'; expected nobody else's tunnel "
            "with this address: end that one, or set multimaster_tunnel to 'none' and use it as it is (docs/operate/hostile_networks.md)."
        )
    more = [
        f"{entry['address']}/{entry['prefix']} on {quote(name)}"
        for name, entry in places
        if name != INTERFACE and entry["address"] != str(tunnel.address) and _overlaps(entry, tunnel.network)
    ]
    if more:
        yield (
            f"{plan.computer}: {', '.join(more)} is in the network of the tunnel, {tunnel.network}; expected no other interface there, since packets "
            "for robots would leave by it outside of the tunnel: give one of the two another network."
        )
    yield from _find_missing(plan, info)


def _find_missing(plan: ComputerPlan, info: Mapping[str, Any]) -> Iterator[str]:
    """Yield a sentence for each thing that a tunnel needs and the machine lacks."""
    if not info["tunnel"]["device"] and not info["tunnel"]["kernel"]:
        yield (
            f"{plan.computer}: the kernel has no WireGuard, and there is no /dev/net/tun, as in some containers; expected one of the two for the "
            "tunnel: load the module (modprobe wireguard), or give the container this device."
        )
    if not info["systemd"]["net_admin"]:
        yield (
            f"{plan.computer}: systemd has no CAP_NET_ADMIN, as in some containers; expected it for multimaster-tunnel.service: give the "
            "container this capability."
        )


def _overlaps(entry: Mapping[str, Any], network: IPv4Network) -> bool:
    """Return True if the network of an address of an interface overlaps another one."""
    if entry.get("family", "inet") != "inet":
        return False
    return IPv4Network(f"{entry['address']}/{entry['prefix']}", strict=False).overlaps(network)


HOOKS = PlanHooks(
    make_part=make_tunnel,
    list_facts=lambda fleet: ("tunnel",) if fleet.overlay else (),
    find_problems=find_tunnel_problems,
    list_packages=list_tunnel_packages,
)
