# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The places where nodes of another master may be. This robot connects to them because that master says so.

The URI of a node goes to the own roscore and to own nodes, which then connect there. So it must name a computer of that
master's robot. A robot of the fleet has its planned computers, under the names of /etc/hosts and any other name that
leads to them. An allowed stranger has its own address, those in networks of this computer, and allowed ones. Only a
second master on this computer has nodes here.
"""

from typing import Container, Dict, FrozenSet, Iterable, List, Mapping, NamedTuple, Optional, Set

from ...protocol.graph import State
from ...protocol.members import LOWEST, MemberRobot, Members
from ...protocol.plain_text import quote
from ...protocol.tcpros.hosts import host_of, is_address, place_of

LOCAL_NAMES = ("localhost", "localhost.localdomain", "ip6-localhost")
MAX_NAMES = 16  # hosts of one state that are looked up


class LocalNetwork(NamedTuple):
    """The addresses and networks of this computer."""

    addresses: FrozenSet[str] = frozenset()
    networks: Optional[Container[str]] = None  # None if they do not matter


class Places:
    """The places of one master's nodes."""

    def __init__(
        self, members: Members, uri: str, monitor_uri: str, here: LocalNetwork, resolved: Mapping[str, str]
    ) -> None:
        """`resolved`: addresses of names that the plan does not have."""
        self._members, self._here, self._resolved = members, here, resolved
        self._member: Optional[MemberRobot] = members.master(uri)
        self._sender = host_of(monitor_uri)

    def find_refusals(self, state: State) -> Dict[str, str]:
        """URI of a misplaced node or service in a state -> the refusal."""
        refusals = {uri: self.find_refusal(uri) for uri in uris(state)}
        return {uri: why for uri, why in refusals.items() if why}

    def find_refusal(self, uri: str) -> str:
        """The reason not to connect to this URI of a node or a service; empty if it is fine."""
        host, port = place_of(uri)
        if not host:
            return "it is not just a port of a host, which is a name or an address in its usual spelling"
        if port < LOWEST:
            return "its port is no node's"
        if self._member is not None and port in self._member.ports:
            return f"port {port} there is its roscore's or its discovery's"
        return self._find_host_refusal(host)

    def _is_here(self, address: str) -> bool:
        return address.startswith(("127.", "0.")) or address in self._here.addresses

    def _find_host_refusal(self, host: str) -> str:
        if self._member is not None and host in self._member.hosts:
            return ""
        if ":" in host:
            return "its host is neither a name nor an IPv4 address"
        address = host if is_address(host) else self._resolved.get(host, "")
        if host in LOCAL_NAMES or self._is_here(address):
            return "" if self._is_here(self._sender) else "it is on this computer itself"
        if self._member is not None and address in self._member.hosts:
            return ""
        # An allowed network may have robots in it: to be allowed is not to be everybody's.
        is_of_robot = address in self._members.hosts and address != self._sender
        if address in self._members.allow and not is_of_robot:
            return ""
        if self._member is not None:
            return f"{quote(host)} is no computer of {self._member.robot}"
        if is_of_robot:
            return f"{quote(host)} is a computer of a robot of the fleet"
        return self._find_stranger_refusal(host, address)

    def _find_stranger_refusal(self, host: str, address: str) -> str:
        if not self._members.robots or address == self._sender:
            return ""
        if not address:
            return f"{quote(host)} has no address on this computer"
        if self._here.networks is not None and address not in self._here.networks:
            return f"{address} is in no network of this computer"
        return ""


def names_to_resolve(state: State, members: Members) -> List[str]:
    """The host names in a state that the plan does not have. Empty if the fleet is not known."""
    if not members.robots:
        return []
    member = members.master(state.uri)
    known = member.hosts if member is not None else frozenset()
    hosts: Set[str] = {host_of(uri) for uri in uris(state)}
    return sorted(host for host in hosts if host and host not in known and not is_address(host) and ":" not in host)[
        :MAX_NAMES
    ]


def uris(state: State) -> Iterable[str]:
    """The URIs of nodes and services in a state."""
    nodes, providers = state.nodes.values(), state.providers.values()
    return (uri for uri in (*(node.uri for node in nodes), *(provider.uri for provider in providers)) if uri)
