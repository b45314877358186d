# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The wanted packet filter, from the options of the module."""

import ipaddress
import re
import typing

from ansible_collections.rosfleet.multimaster.plugins.module_utils._module.problem import Problem

FIRST, LAST = 1024, 65535  # the protected ports, of TCP and of UDP

_PORT = re.compile(r"([0-9]{1,5})/(tcp|udp)")
_Network = typing.Union[ipaddress.IPv4Network, ipaddress.IPv6Network]


class Port(typing.NamedTuple):
    """A port that stays open to everybody."""

    protocol: str  # tcp or udp
    number: int


class Wanted(typing.NamedTuple):
    """The filter of one computer: who gets in, and what is protected beside the computer itself."""

    members: typing.Tuple[str, ...]  # addresses and networks, of IPv4 and of IPv6
    networks: typing.Tuple[str, ...]  # of IPv4
    open_ports: typing.Tuple[Port, ...]
    ssh: typing.Tuple[int, ...] = ()  # TCP ports that the filter does not touch: rules of others decide about them

    def of_version(self, version: int) -> typing.List[str]:
        """The members of IPv4 or of IPv6."""
        return [member for member in self.members if (":" in member) == (version == 6)]

    def open(self, protocol: str) -> typing.List[int]:
        """The ports of one protocol that the filter closes to nobody."""
        opened = [port.number for port in self.open_ports if port.protocol == protocol]
        return sorted({*opened, *(self.ssh if protocol == "tcp" else ())})

    def closed(self, protocol: str) -> typing.List[typing.Tuple[int, int]]:
        """The protected ports of one protocol as ranges, without those of ssh."""
        apart = [*(sorted(self.ssh) if protocol == "tcp" else ()), LAST + 1]
        ranges = [(before + 1, port - 1) for before, port in zip([FIRST - 1, *apart], apart)]
        return [(first, last) for first, last in ranges if first <= last]


def read(options: typing.Mapping[str, typing.Any], ssh: typing.Iterable[int]) -> typing.Optional[Wanted]:
    """Read the options; None where no filter is wanted. `ssh` are ports that stay open beside. Raises Problem."""
    also = _networks("also", options["also"])
    members = _networks("members", options["members"] and [*options["members"], *also])
    networks = _networks("networks", options["networks"])
    ports = {_port(text) for text in options["open_ports"]}
    for number in options["ssh_ports"]:
        if not 0 < number <= LAST:
            raise Problem(f"ssh_ports has {number}, expected ports such as 2222: correct it.")
    if not members:
        if networks:
            raise Problem(
                f"networks has {networks[0]}, but members is empty; expected those who may reach it: name them, or leave networks empty."
            )
        return None
    if any(":" in network for network in networks):
        raise Problem(
            "networks has a network of IPv6, expected networks of robots, which are of IPv4: leave it out, for the packet filter "
            "of each computer closes IPv6 by itself."
        )
    open_ports = tuple(sorted(port for port in ports if port.number >= FIRST))
    untouched = tuple(sorted({number for number in [*ssh, *options["ssh_ports"]] if number >= FIRST}))
    return Wanted(tuple(members), tuple(networks), open_ports, untouched)


def _networks(option: str, texts: typing.Iterable[str]) -> typing.List[str]:
    """The addresses and networks in normal form, without those that are part of another one."""
    found: typing.List[_Network] = []
    for text in texts:
        try:
            network = ipaddress.ip_network(text)
        except ValueError as problem:
            raise Problem(
                f"{option} has {text!r}, which is no address and no network ({problem}); expected for example 192.168.1.229 or "
                "192.168.11.0/24: correct it."
            ) from problem
        if network not in found:
            found.append(network)
    return [_text(network) for network in found if not any(_is_part(network, other) for other in found)]


def _is_part(network: _Network, other: _Network) -> bool:
    """True for a network within another one: two networks that overlap are one within the other."""
    return network.version == other.version and network.prefixlen > other.prefixlen and network.overlaps(other)


def _text(network: _Network) -> str:
    return str(network.network_address) if network.num_addresses == 1 else str(network)


def _port(text: str) -> Port:
    found = _PORT.fullmatch(text)
    if not found or not 0 < int(found.group(1)) <= LAST:
        raise Problem(f"open_ports has {text!r}, expected a port and its protocol, for example 51820/udp: correct it.")
    return Port(found.group(2), int(found.group(1)))
