# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Checks whether the addresses and networks of an inventory can be routed (section 4.1 of the report).

Addresses and networks in, sentences out. A missing value is one sentence. And the addresses in a tunnel.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from ipaddress import IPv4Address, IPv4Network
from typing import Any

from .model import Router

Values = Mapping[str, Any]

# The variables of a robot's own network, and the value that each is expected to have.
_EXAMPLES = {
    "network": "the robot's own network, such as 192.168.11.0/24",
    "gateway": "the computer of the robot that connects it with the common network, one of {hosts}",
    "common_address": "the gateway's address in the common network, such as 192.168.1.201",
}


@dataclass(frozen=True)
class NetworkVariables:
    """A robot's network in the words of its variables. None: not set."""

    hosts: Sequence[str]
    network: IPv4Network | None
    gateway: str | IPv4Address | None
    common_address: IPv4Address | None
    unread: frozenset[str] = frozenset()  # variables with a value that is not of its kind
    sealed: Collection[str] = ()  # computers of multimaster_sealed

    @classmethod
    def from_values(cls, hosts: Sequence[str], own: Mapping[str, Any], raw: Mapping[str, Any]) -> NetworkVariables:
        """Return the network of a robot. `own` has its values, `raw` those of the inventory before they were read."""
        values = {name: own.get(f"multimaster_{name}") for name in _EXAMPLES}
        present = {name for name in _EXAMPLES if raw.get(f"multimaster_{name}") is not None}
        unread = frozenset(name for name in present if values[name] is None)
        return cls(hosts, **values, unread=unread, sealed=own.get("multimaster_sealed", ()))

    @property
    def gateway_host(self) -> str | None:
        """The computer of the robot that is the gateway. None: the gateway is a device without a plan, or not known."""
        return self.gateway if isinstance(self.gateway, str) and self.gateway in self.hosts else None


def find_network_problems(
    common: IPv4Network | None,
    addresses: Mapping[str, IPv4Address],
    robots: Mapping[str, NetworkVariables],
    router: Router | None,
    tunnel: IPv4Network | None = None,
) -> list[str]:
    """Return the reasons why packets cannot go everywhere and back, one sentence each.

    `common` is the common network, `tunnel` that of a tunnel through it, each None if it is not known. `addresses` has the address of each
    host and sealed computer.
    """
    problems: list[str] = []
    for robot, own in robots.items():
        problems += _check_completeness(robot, own)
        problems += _check_members(own, common, addresses)
        problems += _check_gateway(robot, own, common, addresses)
    problems += _check_overlaps({"multimaster_common_network": common, "multimaster_tunnel_network": tunnel}, robots)
    problems += _check_uniqueness(addresses, robots, router)
    if router and common:
        problems += _check_address(router.name or "The router", _variable_of(router), router.address, common)
    return problems


def _variable_of(router: Router) -> str:
    return "multimaster_address" if router.name else "multimaster_router"


def _check_completeness(robot: str, own: NetworkVariables) -> Iterator[str]:
    """Check that all three variables of a robot's own network are set, or that all are missing."""
    present = [name for name in _EXAMPLES if getattr(own, name)]
    for name, example in _EXAMPLES.items() if own.hosts and present else ():
        if not getattr(own, name) and name not in own.unread:
            yield (
                f"{own.hosts[0]}: multimaster_{name} of the robot {robot} is not set, but multimaster_{present[0]} is; expected "
                f"{example.format(hosts=', '.join(own.hosts))}: set it in group_vars/{robot}.yml."
            )


def _check_members(
    own: NetworkVariables, common: IPv4Network | None, addresses: Mapping[str, IPv4Address]
) -> Iterator[str]:
    """Check that every computer is in the network of its robot."""
    if not own.network and (own.gateway or own.common_address):
        return  # _check_completeness has a sentence for it
    network, variable = (own.network, "multimaster_network") if own.network else (common, "multimaster_common_network")
    for host in (*own.hosts, *own.sealed):
        if network and host in addresses:
            yield from _check_address(host, _address_variable(host, own), addresses[host], network, variable)


def _address_variable(host: str, *robots: NetworkVariables) -> str:
    """Name the variable with the address of a computer."""
    return "multimaster_sealed" if any(host in own.sealed for own in robots) else "multimaster_address"


def _check_gateway(
    robot: str, own: NetworkVariables, common: IPv4Network | None, addresses: Mapping[str, IPv4Address]
) -> Iterator[str]:
    """Check that the gateway is in both networks."""
    where = f"group_vars/{robot}.yml"
    named: Mapping[Any, str] = {address: host for host, address in addresses.items()}
    if own.gateway in own.sealed or named.get(own.gateway) in own.sealed:
        return  # contradictions has a sentence for it
    if isinstance(own.gateway, str) and not own.gateway_host:
        yield (
            f"{own.hosts[0]}: multimaster_gateway of the robot {robot} is '{own.gateway}', which is none of its computers; "
            f"expected one of {', '.join(own.hosts)}, or the address of another device: correct it in {where}."
        )
    elif own.gateway in named:
        host = named[own.gateway]
        yield (
            f"{own.hosts[0]}: multimaster_gateway of the robot {robot} is {own.gateway}, the address of {host}; expected the "
            f"name of a computer of the inventory: write {host} in {where}."
        )
    elif isinstance(own.gateway, IPv4Address) and own.network:
        yield from _check_address(own.hosts[0], "multimaster_gateway", own.gateway, own.network, "multimaster_network")
    if own.common_address and common and own.hosts:
        host = own.gateway_host or own.hosts[0]
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


def _check_overlaps(shared: Mapping[str, IPv4Network | None], robots: Mapping[str, NetworkVariables]) -> Iterator[str]:
    """Check that no address is in two networks. Sorted by their begin, each is compared with the widest one before it."""
    names = [(own.network, f"multimaster_network of the robot {robot}") for robot, own in robots.items() if own.network]
    names += [(network, name) for name, network in shared.items() if network]
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


def _check_uniqueness(
    addresses: Mapping[str, IPv4Address], robots: Mapping[str, NetworkVariables], router: Router | None
) -> Iterator[str]:
    """Check that every address belongs to one computer."""
    claims = [(host, _address_variable(host, *robots.values()), address) for host, address in addresses.items()]
    for robot, own in robots.items():
        if own.common_address and own.hosts:
            host = own.gateway_host or f"the gateway of {robot}"
            claims.append((host, "multimaster_common_address", own.common_address))
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


# The addresses of a tunnel, computed from those of the network that carries it. A computer has the same place in both: 192.168.1.229
# is 10.77.0.229 in the tunnel. So its address stays when others come and go.

NETWORK = "multimaster_tunnel_network"
_COMMON, _ADDRESS, _PLACE, _ENDPOINT = (
    f"multimaster_{name}" for name in ("common_network", "address", "common_address", "endpoint")
)


def find_wrong_tunnel_network(shared: Values) -> Iterator[str]:
    """Yield a sentence for a network of the tunnel that cannot be one."""
    network, common = shared.get(NETWORK), shared.get(_COMMON)
    if network is None:
        return
    if shared.get("multimaster_tunnel") == "none":
        yield (
            f"{NETWORK} is '{network}', but multimaster_tunnel is 'none'; expected 'wireguard': set it in group_vars/robots.yml, or remove "
            f"{NETWORK}."
        )
    if common is not None and common.prefixlen != network.prefixlen:
        yield (
            f"{NETWORK} is '{network}', and multimaster_common_network is '{common}'; expected a prefix length of {common.prefixlen} for both, "
            "since each computer has the same place in both: correct it in group_vars/robots.yml."
        )


def move_into_tunnel(
    hosts: Mapping[str, Values], shared: Values, robots: Mapping[str, Values]
) -> tuple[Mapping[str, Values], Values, Mapping[str, Values]]:
    """Return the values of the hosts, the fleet and the robots with the tunnel as the common network.

    An address in the network that carries the tunnel becomes the endpoint, unless another one is given, or none.
    """
    network, common = shared.get(NETWORK), shared[_COMMON]
    if network is None:
        return hosts, shared, robots
    places = {own["multimaster_gateway"]: own[_PLACE] for own in robots.values() if _PLACE in own}
    places |= {
        host: values[_ADDRESS] for host, values in hosts.items() if host not in places and values[_ADDRESS] in common
    }
    moved = {
        host: {_ENDPOINT: places[host], **values, **_move(values, _ADDRESS, common, network)}
        if host in places
        else values
        for host, values in hosts.items()
    }
    own = {name: {**values, **_move(values, _PLACE, common, network)} for name, values in robots.items()}
    return moved, {**shared, _COMMON: network}, own


def _move(values: Values, name: str, common: IPv4Network, network: IPv4Network) -> dict[str, IPv4Address]:
    """Return a variable with the same place in the other network, if its address is in the first."""
    address = values.get(name)
    if address is None or address not in common:
        return {}
    return {name: network[int(address) - int(common.network_address)]}
