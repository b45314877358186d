# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Who belongs to the fleet: which address may be which master, where its nodes may be, and who may ask for the state.

~members has the robots of the fleet. A master of one of them is this robot at its planned addresses alone, whatever
~strangers says. Every other computer is a stranger: allowed, or ignored. Without ~members every computer is allowed.
"""

import ipaddress
import re
from functools import lru_cache
from typing import Any, FrozenSet, Iterable, Mapping, NamedTuple, Optional, Tuple

from .plain_text import quote

IGNORE, ALLOW = "ignore", "allow"
STRANGERS, ALLOWED = "", "allowed computers"  # who is at an address, in the place of a robot
LOWEST = 1024  # ports below it are of ssh and the like, never of a node, whatever a robot says of its nodes


class Member(NamedTuple):
    """A robot of the fleet. Its router is one without a master."""

    robot: str
    name: str  # of its master
    uris: FrozenSet[str]  # that its master may have
    rpc_port: int
    addresses: FrozenSet[str]  # of the computer with its master
    hosts: FrozenSet[str]  # names and addresses of all its computers
    ports: FrozenSet[int]  # of its roscore and its discovery: no node has them

    @classmethod
    def from_entry(cls, entry: Mapping[str, Any]) -> "Member":
        """Read an entry of ~members, which has been checked."""
        uris = frozenset(normalize_uri(uri) for uri in entry["uris"])
        ports = {entry["rpc_port"], *(port_of(uri) for uri in uris)}
        return cls(
            robot=entry["robot"],
            name=entry["name"],
            uris=uris,
            rpc_port=entry["rpc_port"],
            addresses=frozenset(entry["addresses"]),
            hosts=frozenset(host.lower() for host in entry["hosts"]),
            ports=frozenset(ports - {0}),
        )


class Networks:
    """Some IPv4 networks; `in` is quick, since a flood asks often."""

    def __init__(self, networks: Iterable[str] = ()) -> None:
        parsed = [ipaddress.IPv4Network(network, strict=False) for network in networks]
        self._ranges = [(int(network.network_address), int(network.netmask)) for network in parsed]

    def __contains__(self, address: object) -> bool:
        try:
            number = int(ipaddress.IPv4Address(address))
        except ValueError:
            return False
        return any(number & mask == start for start, mask in self._ranges)


class Members:
    """The robots of the fleet, and what becomes of strangers."""

    def __init__(self, robots: Iterable[Member] = (), strangers: str = ALLOW, allow: Iterable[str] = ()) -> None:
        self.robots = tuple(robots)
        self.strangers = strangers
        self.allow = Networks(allow)
        self._by_uri = {uri: robot for robot in self.robots for uri in robot.uris}
        self._by_address = {address: robot for robot in self.robots for address in robot.addresses}
        self._names = {robot.name.lower() for robot in self.robots if robot.name}
        self._by_host = {host: robot.robot for robot in self.robots for host in robot.hosts}
        self.hosts = frozenset(host for robot in self.robots for host in robot.hosts)

    @classmethod
    def from_parameters(cls, parameters: Mapping[str, Any]) -> "Members":
        """The members in the parameters of a node, which have been checked."""
        robots = [Member.from_entry(entry) for entry in parameters.get("members") or ()]
        return cls(robots, parameters.get("strangers", ALLOW), parameters.get("allow") or ())

    def master(self, uri: str) -> Optional[Member]:
        """The robot whose master has this URI; None for a stranger's."""
        return self._by_uri.get(normalize_uri(uri))

    def member_at(self, address: str) -> Optional[Member]:
        """The robot whose master is on the computer with this address."""
        return self._by_address.get(address)

    def is_discovery(self, address: str, rpc_port: int) -> bool:
        """True where the discovery of a robot of the fleet is planned to answer."""
        member = self._by_address.get(address)
        return member is not None and member.rpc_port == rpc_port

    def admits(self, address: str) -> bool:
        """True where a master at this address may be one to exchange with, though no robot of the fleet is planned there."""
        return self.strangers == ALLOW or address in self.allow

    def knows(self, address: str) -> bool:
        """True for a computer of the fleet, and for who is allowed by name."""
        return address in self.allow or address in self.hosts

    def robot_at(self, address: str) -> str:
        """The robot with a computer at this address; STRANGERS or ALLOWED for all of these together. Without robots, each address is one."""
        if not self.robots:
            return address
        return self._by_host.get(address) or (ALLOWED if address in self.allow else STRANGERS)

    def objection(self, uri: str, name: str, address: str) -> str:
        """Why the master that calls itself so, at this address, is none to exchange with; empty where it is one."""
        member = self.master(uri)
        if member is not None:
            if address not in member.addresses:
                planned = " or ".join(sorted(member.addresses))
                return f"it says that it is {member.name}, which is at {planned}"
            return ""
        if name.lower() in self._names:
            return (
                f"it has the name of the master of a robot of the fleet, {quote(name)}, but another URI, {quote(uri)}"
            )
        if self.admits(address):
            return ""
        there = self.member_at(address)
        if there is not None:
            return f"it is on the computer of {there.name}, whose master is not {quote(uri)}"
        return "it is no robot of the fleet"


def normalize_uri(uri: str) -> str:
    """A URI of a master in one spelling: case and the slash at its end do not matter."""
    return uri.lower().rstrip("/")


# No path, user or query: programs differ in what they take for the host of such a text.
_URI = re.compile(r"[a-z]+://(?:([a-z0-9_.-]+)|\[([0-9a-f:]+)\])(?::([0-9]{1,5}))?/?", re.ASCII | re.IGNORECASE)
_LABEL = "[a-z0-9_](?:[a-z0-9_-]{0,61}[a-z0-9_])?"
# getaddrinfo(3) takes a number at the end for an address: 127.1, 2130706433, 0x7f.1
_HOST_NAME = re.compile(rf"(?:{_LABEL}\.)*(?!(?:[0-9]+|0x[0-9a-f]*)\Z){_LABEL}")


@lru_cache(4096)  # used with each news of a master
def place_of(uri: str) -> Tuple[str, int]:
    """The host of a URI in its only spelling, and its port, 0 where it has none. An empty host: it has none, or another spelling.

    A host is an IPv4 address in its usual spelling, an IPv6 address as RFC 5952 writes it, or a name in small letters. All
    other ways to write an address are refused, since a list of hosts has each one once.
    """
    found = _URI.fullmatch(uri)
    if found is None or int(found[3] or 0) >= 1 << 16:
        return "", 0
    name, inner = (found[1] or "").lower(), found[2]
    good = is_address(name) or _HOST_NAME.fullmatch(name)
    return (_normalize_ipv6(inner) if inner else name if good else ""), int(found[3] or 0)


def _normalize_ipv6(text: str) -> str:
    """An IPv6 address in its only spelling; empty for none, and for an IPv4 address that is written as one."""
    try:
        address = ipaddress.IPv6Address(text)
    except ValueError:
        return ""
    return "" if address.ipv4_mapped else str(address)


def host_of(uri: str) -> str:
    """The host of a URI as `place_of` has it."""
    return place_of(uri)[0]


def port_of(uri: str) -> int:
    """The port of a URI; 0 where it has none."""
    return place_of(uri)[1]


def is_address(host: str) -> bool:
    """True for an IPv4 address in its usual spelling: 010 is 8 for some programs."""
    try:
        return str(ipaddress.IPv4Address(host)) == host
    except ValueError:
        return False
