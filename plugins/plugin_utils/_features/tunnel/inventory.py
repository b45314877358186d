# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The tunnel of a fleet: the contradictions of its variables, and the fleet with the tunnel as its common network."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from ipaddress import IPv4Address

from ..._base.sentences import nearest, shorten_list
from ..._inventory.hooks import InventoryHooks
from ..._inventory.model import Fleet, Inventory, Overlay
from ..._inventory.read import make_robot
from ..._inventory.variables import FleetVariables
from .variables import EndpointVariables, TunnelVariables


def make_overlay(fleet: Fleet, inventory: Inventory) -> Fleet:
    """Return the fleet with the tunnel as its common network. The hub is None without one, and for a name that no computer has."""
    given = TunnelVariables.read(fleet.variables)
    if given.tunnel == "none":
        return fleet
    fleet = _move_into_network(fleet, inventory)
    hub = next((computer for computer in fleet.computers if computer.name == given.tunnel_hub), None)
    return replace(fleet, overlay=Overlay(hub))


def find_wrong_tunnel(fleet: Fleet) -> list[str]:
    """Return a sentence for each thing that a tunnel cannot be together with."""
    given, shared = TunnelVariables.read(fleet.variables), fleet.variables
    if given.tunnel == "none":
        return []
    where = "in group_vars/robots.yml"
    wrong = [
        (
            shared.transport != "unicast",
            f"multimaster_transport is '{shared.transport}'; expected 'unicast', since a tunnel carries no multicast: set it {where}",
        ),
        (
            fleet.multicast_routing != "none",
            f"multimaster_multicast_routing is 'smcroute'; expected 'none', since a tunnel carries no multicast: remove it {where}",
        ),
        (
            shared.firewall != "fleet",
            f"multimaster_firewall is 'none'; expected 'fleet', since the ports of ROS would be open outside of the tunnel: set it {where}",
        ),
        (
            fleet.router is not None,
            "the common network has a router; expected none, since each computer reaches the others by the tunnel itself: remove "
            "multimaster_router or the group 'routers'",
        ),
        *_find_wrong_places(fleet),
    ]
    return [f"multimaster_tunnel is '{given.tunnel}', but {sentence}." for is_so, sentence in wrong if is_so]


def _find_wrong_places(fleet: Fleet) -> Iterator[tuple[bool, str]]:
    """Yield the faults of the computers in a tunnel: whether there is one, and its sentence."""
    given, network = TunnelVariables.read(fleet.variables), fleet.variables.common_network
    inside = [computer for computer in fleet.computers if computer.common_address]
    ends = {computer.name: EndpointVariables.read(computer.variables).endpoint for computer in inside}
    yield from _find_unreachable(ends, given.tunnel_hub)
    within = [name for name, end in ends.items() if end and end in network]
    yield (
        bool(within),
        f"multimaster_endpoint of {shorten_list(within)} is in the tunnel itself ({network}); expected the address in the network that carries "
        "the tunnel",
    )
    yield from _find_wrong_endpoints(fleet, {name: end for name, end in ends.items() if end})
    yield (
        given.tunnel_port == fleet.variables.multicast_port,
        f"multimaster_tunnel_port is {given.tunnel_port}, the port of discovery; expected another one, such as 51820",
    )
    sealed = [computer.name for computer in inside if computer.sealed]
    yield (
        bool(sealed),
        f"{shorten_list(sealed)} in the common network is sealed; expected computers at which one may log in, since each makes its own key",
    )
    devices = [robot.name for robot in fleet.robots if robot.gateway and not robot.gateway.name]
    yield (
        bool(devices),
        f"the gateway of {shorten_list(devices)} is no computer of the inventory; expected one that has a key",
    )


def _find_wrong_endpoints(fleet: Fleet, ends: Mapping[str, IPv4Address]) -> Iterator[tuple[bool, str]]:
    """Yield the faults of the addresses at which computers are reached from outside."""
    twice = sorted(end for end in set(ends.values()) if list(ends.values()).count(end) > 1)
    yield (
        bool(twice),
        f"multimaster_endpoint is {shorten_list(map(str, twice))} on {shorten_list(name for name, end in ends.items() if end in twice)}; expected "
        "an address for each computer, since all tunnels have one port",
    )
    within = [
        name for name, end in ends.items() if any(end in robot.network for robot in fleet.robots if robot.gateway)
    ]
    yield (
        bool(within),
        f"multimaster_endpoint of {shorten_list(within)} is in the own network of a robot, which is reached by the tunnel; expected the address "
        "in the network that carries the tunnel",
    )


def _find_unreachable(ends: Mapping[str, IPv4Address | None], hub: str | None) -> Iterator[tuple[bool, str]]:
    """Yield the faults of the endpoints of the computers in a tunnel, and with its hub."""
    silent = [name for name, end in ends.items() if end is None]
    yield (
        len(silent) > 1 and not hub,
        f"{shorten_list(silent)} have no multimaster_endpoint; expected it of all computers in the common network but one, since of two one must "
        "know the address of the other: add it, or name a computer that all reach in multimaster_tunnel_hub",
    )
    yield (
        bool(hub) and ends.get(hub or "") is None,
        f"multimaster_tunnel_hub is '{hub}'; expected a computer in the common network with a multimaster_endpoint, at which all others reach it"
        f"{nearest(hub or '', [name for name, end in ends.items() if end])}",
    )


def find_wrong_tunnel_network(shared: FleetVariables) -> Iterator[str]:
    """Yield a sentence for a network of the tunnel that cannot be one."""
    network, common = TunnelVariables.read(shared).tunnel_network, shared.common_network
    if network is None:
        return
    if TunnelVariables.read(shared).tunnel == "none":
        yield (
            f"multimaster_tunnel_network is '{network}', but multimaster_tunnel is 'none'; expected 'wireguard': set it in group_vars/robots.yml, "
            "or remove multimaster_tunnel_network."
        )
    if common and common.prefixlen != network.prefixlen:
        yield (
            f"multimaster_tunnel_network is '{network}', and multimaster_common_network is '{common}'; expected a prefix length of "
            f"{common.prefixlen} for both, since each computer has the same place in both: correct it in group_vars/robots.yml."
        )


# The addresses of a tunnel, computed from those of the network that carries it. A computer has the same place in both: 192.168.1.229
# is 10.77.0.229 in the tunnel. So its address stays when others come and go.


def _move_into_network(fleet: Fleet, inventory: Inventory) -> Fleet:
    """Return the fleet with the tunnel as its common network.

    An address in the network that carries the tunnel becomes the endpoint, unless `multimaster_endpoint` is set, also to `none`.
    """
    network, common = TunnelVariables.read(fleet.variables).tunnel_network, fleet.variables.common_network
    if network is None:
        return fleet

    def move(address: IPv4Address) -> IPv4Address:
        """Return the same place in the other network, if an address is in the first."""
        return network[int(address) - int(common.network_address)] if address in common else address

    robots = []
    for robot in fleet.robots:
        hosts = {}
        for computer in robot.computers[: len(robot.hosts)]:
            values, is_given = computer.variables, inventory.is_set(computer.name, "endpoint")
            endpoint = EndpointVariables.read(values).endpoint if is_given else computer.common_address
            features = {**values.features, "tunnel": EndpointVariables(endpoint)}
            hosts[computer.name] = replace(values, address=move(values.address), features=features)
        own = robot.variables
        own = replace(own, common_address=own.common_address and move(own.common_address))
        robots.append(make_robot(robot.name, hosts, own, network))
    return replace(fleet, robots=tuple(robots), variables=replace(fleet.variables, common_network=network))


HOOKS = InventoryHooks(
    list_networks=lambda shared: [(TunnelVariables.read(shared).tunnel_network, "multimaster_tunnel_network")],
    find_wrong_variables=find_wrong_tunnel_network,
    change_fleet=make_overlay,
    find_contradictions=find_wrong_tunnel,
)
