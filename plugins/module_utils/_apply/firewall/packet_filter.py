# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The packet filter of a computer, from the options of the module."""

import ipaddress
import re
import typing

from ..._base.problem import Problem

FIRST, LAST = 1024, 65535  # the protected ports, of TCP and of UDP

_PORT = re.compile(r"([0-9]{1,5})/(tcp|udp)")
# A "*" at the end would mean many to nft; a kernel takes other characters, but no name of an interface needs them.
_INTERFACE = re.compile(r"[A-Za-z0-9_.:@-]{1,15}")
_Network = typing.Union[ipaddress.IPv4Network, ipaddress.IPv6Network]


class OpenPort(typing.NamedTuple):
    """A port that stays open to all senders."""

    protocol: str  # tcp or udp
    number: int


class Guard(typing.NamedTuple):
    """Networks, and the one interface at which packets from their addresses come in."""

    networks: typing.Tuple[str, ...]
    interface: str


class PacketFilter(typing.NamedTuple):
    """The filter of one computer: the senders that it lets in, and the networks that it protects."""

    members: typing.Tuple[str, ...]  # addresses and networks, of IPv4 and of IPv6
    networks: typing.Tuple[str, ...]  # of IPv4; the computer itself is always protected
    open_ports: typing.Tuple[OpenPort, ...]
    ssh: typing.Tuple[int, ...] = ()  # TCP ports that the filter does not touch: foreign rules decide about them
    guards: typing.Tuple[Guard, ...] = ()

    def list_members(self, version: int) -> typing.List[str]:
        """The members of IPv4 or of IPv6."""
        return [member for member in self.members if (":" in member) == (version == 6)]

    def list_open_ports(self, protocol: str) -> typing.List[int]:
        """The ports of one protocol that the filter leaves open to all senders."""
        numbers = [port.number for port in self.open_ports if port.protocol == protocol]
        return sorted({*numbers, *(self.ssh if protocol == "tcp" else ())})

    def list_closed_ranges(self, protocol: str) -> typing.List[typing.Tuple[int, int]]:
        """The protected ports of one protocol as ranges, without those of ssh."""
        gaps = [*(sorted(self.ssh) if protocol == "tcp" else ()), LAST + 1]
        ranges = [(before + 1, port - 1) for before, port in zip([FIRST - 1, *gaps], gaps)]
        return [(first, last) for first, last in ranges if first <= last]


def read_options(options: typing.Mapping[str, typing.Any], ssh: typing.Iterable[int]) -> typing.Optional[PacketFilter]:
    """Read the options; None if no filter is wanted. `ssh`: ports that stay open, too. Raises Problem."""
    also = _parse_networks("also", options["also"])
    members = _parse_networks("members", options["members"] and [*options["members"], *also])
    networks = _parse_networks("networks", options["networks"])
    guards = tuple(map(_parse_guard, options["guards"]))
    ports = {_parse_port(text) for text in options["open_ports"]}
    _check_ssh_ports(options["ssh_ports"])
    if not members:
        if networks or guards:
            raise Problem(
                f"{'networks' if networks else 'guards'} has {(networks or guards[0].networks)[0]}, but members is empty; expected the computers "
                "that may reach this one: name them, or leave the other empty."
            )
        return None
    if any(":" in network for network in networks):
        raise Problem(
            "networks has a network of IPv6, expected networks of robots, which are of IPv4: leave it out; the packet filter of "
            "each computer closes IPv6 by itself."
        )
    open_ports = tuple(sorted(port for port in ports if port.number >= FIRST))
    ssh_ports = tuple(sorted({number for number in [*ssh, *options["ssh_ports"]] if number >= FIRST}))
    return PacketFilter(tuple(members), tuple(networks), open_ports, ssh_ports, guards)


def _check_ssh_ports(numbers: typing.Iterable[int]) -> None:
    """Raises Problem for a number that is no port."""
    for number in numbers:
        if not 0 < number <= LAST:
            raise Problem(f"ssh_ports has {number}, expected ports such as 2222: correct it.")


def _parse_guard(guard: typing.Mapping[str, typing.Any]) -> Guard:
    """Read a guard. Raises Problem for a name that no interface of Linux can have, or that nft would read otherwise."""
    if not _INTERFACE.fullmatch(guard["interface"]):
        raise Problem(f"guards has the interface {guard['interface']!r}, expected a name such as eth0: correct it.")
    return Guard(tuple(_parse_networks("guards", guard["networks"])), guard["interface"])


def _parse_networks(option: str, texts: typing.Iterable[str]) -> typing.List[str]:
    """The addresses and networks in normal form, without those inside a larger one of them."""
    networks: typing.Dict[_Network, None] = {}  # in their order
    for text in texts:
        try:
            networks[ipaddress.ip_network(text)] = None
        except ValueError as problem:
            raise Problem(
                f"{option} has {text!r}, which is no address and no network ({problem}); expected for example 192.168.1.229 or "
                "192.168.11.0/24: correct it."
            ) from problem
    lengths = {network.prefixlen for network in networks}
    return [_format_network(network) for network in networks if not _has_larger(network, networks, lengths)]


def _has_larger(network: _Network, networks: typing.Container[_Network], lengths: typing.Iterable[int]) -> bool:
    """Return True if one of these networks contains this one; `lengths` are their prefixes. The time grows with the prefixes alone."""
    return any(network.supernet(new_prefix=length) in networks for length in lengths if length < network.prefixlen)


def _format_network(network: _Network) -> str:
    return str(network.network_address) if network.num_addresses == 1 else str(network)


def _parse_port(text: str) -> OpenPort:
    match = _PORT.fullmatch(text)
    if not match or not 0 < int(match.group(1)) <= LAST:
        raise Problem(f"open_ports has {text!r}, expected a port and its protocol, for example 51820/udp: correct it.")
    return OpenPort(match.group(2), int(match.group(1)))
