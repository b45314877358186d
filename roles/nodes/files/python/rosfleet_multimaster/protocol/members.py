# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The members of the fleet: the addresses of each master, the places of its nodes, and the computers that may ask for the state.

~members has the robots of the fleet. A master of one of them is this robot only at its planned addresses, whatever
~strangers says. Every other computer is a stranger: allowed, or ignored. Without ~members every computer is allowed.
"""

import ipaddress
from typing import Any, FrozenSet, Iterable, Mapping, NamedTuple, Optional

from .plain_text import quote
from .tcpros.hosts import port_of

IGNORE, ALLOW = "ignore", "allow"
STRANGERS, ALLOWED = "", "allowed computers"  # who is at an address, in the place of a robot
NOBODIES = (STRANGERS, ALLOWED)  # these are no robots
LOWEST = 1024  # ports below it are of ssh and the like, never of a node, whatever a robot says of its nodes


class MemberRobot(NamedTuple):
    """A robot of the fleet. Its router is one without a master."""

    robot: str
    name: str  # of its master
    uris: FrozenSet[str]  # that its master may have
    rpc_port: int
    addresses: FrozenSet[str]  # of the computer with its master
    hosts: FrozenSet[str]  # names and addresses of all its computers
    ports: FrozenSet[int]  # of its roscore and its discovery: no node has them

    @classmethod
    def from_entry(cls, entry: Mapping[str, Any]) -> "MemberRobot":
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
    """The robots of the fleet, and the treatment of strangers."""

    def __init__(self, robots: Iterable[MemberRobot] = (), strangers: str = ALLOW, allow: Iterable[str] = ()) -> None:
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
        robots = [MemberRobot.from_entry(entry) for entry in parameters.get("members") or ()]
        return cls(robots, parameters.get("strangers", ALLOW), parameters.get("allow") or ())

    def master(self, uri: str) -> Optional[MemberRobot]:
        """The robot whose master has this URI; None for a stranger's."""
        return self._by_uri.get(normalize_uri(uri))

    def member_at(self, address: str) -> Optional[MemberRobot]:
        """The robot whose master is on the computer with this address."""
        return self._by_address.get(address)

    def is_discovery(self, address: str, rpc_port: int) -> bool:
        """True if the discovery of a robot of the fleet is planned to answer."""
        member = self._by_address.get(address)
        return member is not None and member.rpc_port == rpc_port

    def admits(self, address: str) -> bool:
        """True if a master at this address may be one to exchange with, though no robot of the fleet is planned there."""
        return self.strangers == ALLOW or address in self.allow

    def knows(self, address: str) -> bool:
        """True for a computer of the fleet, and for who is allowed by name."""
        return address in self.allow or address in self.hosts

    def robot_at(self, address: str) -> str:
        """The robot with a computer at this address; STRANGERS or ALLOWED for all of these together. Without robots, each address is one."""
        if not self.robots:
            return address
        return self._by_host.get(address) or (ALLOWED if address in self.allow else STRANGERS)

    def find_refusal(self, uri: str, name: str, address: str) -> str:
        """The reason for exchanging nothing with the master that calls itself so at this address; empty if it is a member."""
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
