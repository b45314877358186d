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
from typing import Any, Dict, FrozenSet, List, Mapping, NamedTuple, Optional, Set, Tuple

from ...protocol.members import LOWEST, Members, host_of, port_of
from ...protocol.messages import NodeKey, Registration
from .permission import ports
from .sync import View

FORGET = 930.0  # seconds after a loss: by then TCP itself has given up (net.ipv4.tcp_retries2)
RESOLVE = 300.0  # seconds between two looks at the address of a host

# As rospy and roscpp describe a connection in getBusInfo; rospy does not know from which port it was called.
_INFO = re.compile(r"TCPROS connection on port (\d+) to \[(?:.*):(\d+|None) on socket")


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
        """True where this connection is to be ended."""
        if remote[0] not in self.addresses or silent < self.silent:
            return False
        return any(Connection(local_port, port) in self.connections for port in (remote[1], None))


@dataclass
class _Master:
    nodes: FrozenSet[NodeKey] = frozenset()  # its nodes that are registered here
    sharing: FrozenSet[NodeKey] = frozenset()  # own nodes with a topic of these
    lost: Optional[float] = None
    noted: Set[Connection] = field(default_factory=set)


class Losses:
    """The notes about each master, for the time when it is lost."""

    def __init__(self, members: Members) -> None:
        self._members, self._ports = members, ports(members)
        self._masters: Dict[str, _Master] = {}
        self._addresses: Dict[str, Tuple[float, FrozenSet[str]]] = {}  # host -> when, and its addresses

    def take_registrations(self, held: Mapping[Registration, str], view: View, claims: Mapping[NodeKey, str]) -> None:
        """Take the registrations, each with its master. Those of a lost master are kept."""
        nodes: Dict[str, Set[NodeKey]] = {}
        sharing: Dict[str, Set[NodeKey]] = {}
        users = view.local_nodes(claims)
        for item, uri in held.items():
            nodes.setdefault(uri, set()).add(item.node_key)
            own = users.get(item.name, ()) if item.kind != "service" else ()
            sharing.setdefault(uri, set()).update(node for node in own if node[1])
        for uri in nodes.keys() | self._masters.keys():
            master = self._masters.setdefault(uri, _Master())
            if master.lost is None:
                master.nodes, master.sharing = frozenset(nodes.get(uri, ())), frozenset(sharing.get(uri, ()))

    def to_resolve(self, now: float) -> List[str]:
        """The hosts of registered nodes to look up. With the loss of a master, name servers may be lost, too."""
        hosts = {host for uri, master in self._masters.items() if master.lost is None for host in _hosts(uri, master)}
        kept = {host for uri, master in self._masters.items() for host in _hosts(uri, master)}
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
        looks, endings = [], []
        for uri, master in list(self._masters.items()):
            if master.lost is None and online.get(uri) is False:
                master.lost = now
                looks.append(Look(uri, master.sharing, frozenset(part for node in master.nodes for part in node)))
            elif master.lost is not None and online.get(uri):
                if master.noted:
                    addresses = frozenset(address for address, _port in self._endpoints(uri, master))
                    endings.append(Disconnection(addresses, frozenset(master.noted), now - master.lost))
                master.lost, master.noted = None, set()
            elif master.lost is not None and now - master.lost >= FORGET:
                del self._masters[uri]
            elif master.lost is None and uri not in online and not master.nodes:  # it has left
                del self._masters[uri]
        return looks, endings

    def take_connections(self, uri: str, connections: Set[Connection]) -> None:
        """Take the connections of a look."""
        master = self._masters.get(uri)
        if master is not None and master.lost is not None:
            master.noted |= connections

    def endpoints(self) -> Set[Tuple[str, int]]:
        """The XML-RPC addresses of nodes of lost masters alone: connections to these are ended."""
        lost: Set[Tuple[str, int]] = set()
        alive: Set[Tuple[str, int]] = set()  # a robot may come back as another master, with a node at the same port
        for uri, master in self._masters.items():
            (alive if master.lost is None else lost).update(self._endpoints(uri, master))
        return lost - alive

    def _endpoints(self, uri: str, master: _Master) -> Set[Tuple[str, int]]:
        believed = self._robot_addresses(uri)
        endpoints: Set[Tuple[str, int]] = set()
        for node in master.nodes:
            port = port_of(node[1])
            if LOWEST <= port < 1 << 16 and port not in self._ports:
                endpoints.update((address, port) for address in self._host_addresses(host_of(node[1])) & believed)
        return endpoints

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


def _hosts(uri: str, master: _Master) -> Set[str]:
    """The hosts of a master and of its nodes; empty if it has no node here."""
    return (
        {host for host in map(host_of, [uri, *(where for _name, where in master.nodes)]) if host}
        if master.nodes
        else set()
    )
