# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""TCP connections to end when a master is lost, and when it comes back: events in, connections to note and to end out.

TCP waits. A connect() to a robot without power takes two minutes to fail, and blocks a thread of the roscore so long. A
cut connection sends again at ever longer intervals, and rospy reads from it for ever. So, while a master is offline, all
connections to the XML-RPC ports of its nodes are ended. When it comes back, connections between its nodes and own ones
are ended if they are still silent: the client libraries then connect anew at once.

A robot is believed only about nodes on its own computers, and never about the port of a roscore or of discovery.

Free of sockets, threads and clocks.
"""

import re
from dataclasses import dataclass, field
from typing import AbstractSet, Any, Dict, FrozenSet, List, Mapping, NamedTuple, Optional, Set, Tuple

from ...protocol.members import LOWEST, Members
from ...protocol.messages import NodeKey, Registration, View
from ...protocol.tcpros.hosts import host_of, port_of
from .permission import ports

FORGET = 930.0  # seconds after a loss: by then TCP itself has given up (net.ipv4.tcp_retries2)
RESOLVE = 300.0  # seconds between two looks at the address of a host

# As rospy and roscpp describe a connection in getBusInfo; rospy does not know from which port it was called.
_INFO = re.compile(r"TCPROS connection on port (\d{1,5}) to \[(?:.*):(\d{1,5}|None) on socket")


class Connection(NamedTuple):
    """A connection of an own node, by its ports; None for an unknown one."""

    local_port: int
    remote_port: Optional[int]


class Look(NamedTuple):
    """Ask these own nodes for their connections with nodes of the master, and hand them to `take_connections`."""

    master: str
    nodes: FrozenSet[NodeKey]  # own nodes
    others: FrozenSet[str]  # names and URIs of the master's nodes


class Disconnection(NamedTuple):
    """End those of these connections to these addresses that were silent for so many seconds."""

    addresses: FrozenSet[str]
    connections: FrozenSet[Connection]
    silent: float

    def wants(self, local_port: int, remote: Tuple[str, int], silent: float) -> bool:
        """True if this connection is to be ended."""
        if remote[0] not in self.addresses or silent < self.silent:
            return False
        return any(Connection(local_port, port) in self.connections for port in (remote[1], None))


@dataclass
class _Loss:
    """The loss of a master."""

    nodes: FrozenSet[NodeKey]  # its nodes that were registered here
    since: float
    noted: Set[Connection] = field(default_factory=set)


class Losses:
    """The lost masters, with the knowledge of each one when it was lost."""

    def __init__(self, members: Members) -> None:
        self._members, self._ports = members, ports(members)
        self._held: Mapping[Registration, str] = {}
        self._view = View({}, {}, {}, {})
        self._claims: Mapping[NodeKey, str] = {}
        self._losses: Dict[str, _Loss] = {}
        self._addresses: Dict[str, Tuple[float, FrozenSet[str]]] = {}  # host -> when, and its addresses
        # URI of each node -> its host and port, read once: there are thousands
        self._places: Dict[str, Tuple[str, int]] = {}

    def take_registrations(self, held: Mapping[Registration, str], view: View, claims: Mapping[NodeKey, str]) -> None:
        """Take the registrations, each with its master, and the nodes that have them."""
        self._held, self._view, self._claims = held, view, claims
        uris = {where for nodes in (claims, *(loss.nodes for loss in self._losses.values())) for _name, where in nodes}
        self._places = {where: self._places.get(where) or (host_of(where), port_of(where)) for where in uris}

    def to_resolve(self, now: float) -> List[str]:
        """The hosts of registered nodes to look up. With the loss of a master, name servers may be lost, too."""
        hosts = {host for uri, nodes in self._list_present().items() for host in self._hosts(uri, nodes)}
        kept = hosts.union(host for uri, loss in self._losses.items() for host in self._hosts(uri, loss.nodes))
        self._addresses = {host: entry for host, entry in self._addresses.items() if host in kept}
        due = [host for host in sorted(hosts) if now - self._addresses.get(host, (-RESOLVE, ()))[0] >= RESOLVE]
        for host in due:
            self._addresses[host] = now, self._addresses.get(host, (now, frozenset()))[1]
        return due

    def take_addresses(self, host: str, addresses: FrozenSet[str], now: float) -> None:
        """Take the addresses of a host that are not this computer's own."""
        self._addresses[host] = now, addresses

    def update(self, online: Mapping[str, bool], now: float) -> Tuple[List[Look], List[Disconnection]]:
        """Take the masters that discovery knows. Return the looks and the disconnections to carry out."""
        looks, endings, present = [], [], self._list_present()
        for uri, loss in list(self._losses.items()):
            if online.get(uri):
                if loss.noted:
                    addresses = frozenset(address for address, _port in self._endpoints(uri, loss.nodes))
                    endings.append(Disconnection(addresses, frozenset(loss.noted), now - loss.since))
                del self._losses[uri]
            elif now - loss.since >= FORGET:
                del self._losses[uri]
        for uri, nodes in present.items():
            if online.get(uri) is False:
                self._losses[uri] = _Loss(frozenset(nodes), now)
                looks.append(Look(uri, self._find_sharing(uri), frozenset(part for node in nodes for part in node)))
        return looks, endings

    def take_connections(self, uri: str, connections: Set[Connection]) -> None:
        """Take the connections of a look."""
        if uri in self._losses:
            self._losses[uri].noted |= connections

    def endpoints(self) -> Set[Tuple[str, int]]:
        """The XML-RPC addresses of nodes of only lost masters: connections to these are ended."""
        ended = {end for uri, loss in self._losses.items() for end in self._endpoints(uri, loss.nodes)}
        # A robot may come back as a different master, with a node at the same port.
        for uri, nodes in self._list_present().items() if ended else ():
            ended -= self._endpoints(uri, nodes)
        return ended

    def _list_present(self) -> Dict[str, Set[NodeKey]]:
        """Master that is not lost -> its nodes that are registered here."""
        nodes: Dict[str, Set[NodeKey]] = {}
        for node, uri in self._claims.items():
            if uri not in self._losses:
                nodes.setdefault(uri, set()).add(node)
        return nodes

    def _find_sharing(self, uri: str) -> FrozenSet[NodeKey]:
        """The own nodes with a topic of a master's nodes."""
        topics = {item.name for item, master in self._held.items() if master == uri and item.kind != "service"}
        tables, uris = (self._view.publishers, self._view.subscribers), self._view.node_uris
        users = {node for table in tables for topic in topics for node in table.get(topic, ()) if uris.get(node)}
        return frozenset({(node, uris[node]) for node in users} - self._claims.keys())

    def _endpoints(self, uri: str, nodes: AbstractSet[NodeKey]) -> Set[Tuple[str, int]]:
        believed = self._robot_addresses(uri)
        endpoints: Set[Tuple[str, int]] = set()
        for _name, where in nodes:
            host, port = self._places[where]
            if LOWEST <= port < 1 << 16 and port not in self._ports:
                endpoints.update((address, port) for address in self._host_addresses(host) & believed)
        return endpoints

    def _hosts(self, uri: str, nodes: AbstractSet[NodeKey]) -> Set[str]:
        """The hosts of a master and of its nodes."""
        return {host_of(uri), *(self._places[where][0] for _name, where in nodes)} - {""}

    def _robot_addresses(self, uri: str) -> FrozenSet[str]:
        """The addresses of a master's robot: the planned ones, or for a stranger those of its master's host.

        A stranger chooses the host of its URI, so addresses of the fleet do not count.
        """
        member = self._members.master(uri)
        return self._host_addresses(host_of(uri)) - self._members.hosts if member is None else member.hosts

    def _host_addresses(self, host: str) -> FrozenSet[str]:
        return self._addresses.get(host, (0.0, frozenset()))[1]


def connections_of(bus_info: Any, others: FrozenSet[str]) -> Set[Connection]:
    """The connections with these nodes (names or URIs) in a node's answer to getBusInfo."""
    connections = set()
    for row in bus_info if isinstance(bus_info, list) else ():
        if isinstance(row, list) and len(row) >= 7 and row[1] in others and isinstance(row[6], str):
            text = _INFO.match(row[6])
            if text:
                connections.add(Connection(int(text[1]), None if text[2] == "None" else int(text[2])))
    return connections
