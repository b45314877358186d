# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Masters, links, registrations and entries of /diagnostics, as the messages and services of ROS carry them.

edge/ros.py converts both ways.
"""

from dataclasses import dataclass, field
from typing import Dict, Iterator, List, Mapping, NamedTuple, Sequence, Set, Tuple

from .plain_text import quote

NodeKey = Tuple[str, str]  # name and URI of a node
Row = Tuple[str, str, str]  # kind, topic or service, node


class AnnouncedMaster(NamedTuple):
    """A master, as discovery announces it (`~changes`) and lists it (`~list_masters`)."""

    name: str
    uri: str
    monitor_uri: str
    discoverer: str
    stamp: float
    local_stamp: float
    online: bool


class LinkQuality(NamedTuple):
    """The quality of the link to a master: per cent of the expected heartbeats, -1 if the master promises no heartbeats."""

    name: str
    quality: float
    silent: float  # seconds since the last datagram
    uri: str = ""  # of the master


#: Kinds of registrations: each has a table in the state of a master, under its plural.
KINDS = ("publisher", "subscriber", "service")


class Registration(NamedTuple):
    """One registration of a node of another master."""

    kind: str  # one of KINDS
    name: str
    node: str
    node_uri: str
    service_uri: str = ""

    @property
    def node_key(self) -> NodeKey:
        """The name and the URI of the node."""
        return self.node, self.node_uri

    def __str__(self) -> str:
        return f"{self.kind} {quote(self.name)} of {quote(self.node)}"


@dataclass
class View:
    """The registrations in the own roscore. URIs are there only for the nodes and services that were asked for."""

    publishers: Mapping[str, Sequence[str]]
    subscribers: Mapping[str, Sequence[str]]
    services: Mapping[str, Sequence[str]]
    types: Mapping[str, str]
    node_uris: Mapping[str, str] = field(default_factory=dict)
    service_uris: Mapping[str, str] = field(default_factory=dict)

    def registrations(self, claims: Mapping[NodeKey, str]) -> Set[Registration]:
        """Everything that the claimed nodes have registered."""
        return {
            Registration(kind, name, *node, self.service_uris.get(name, "") if kind == "service" else "")
            for kind, name, node in self._rows()
            if node in claims
        }

    def local_nodes(self, claims: Mapping[NodeKey, str]) -> Dict[str, Dict[NodeKey, None]]:
        """Topic -> the nodes on it that are not claimed: this robot's own. "" is an unknown URI."""
        users: Dict[str, Dict[NodeKey, None]] = {}
        for kind, topic, node in self._rows():
            if kind != "service" and node not in claims:
                users.setdefault(topic, {})[node] = None
        return users

    def _rows(self) -> Iterator[Tuple[str, str, NodeKey]]:
        return ((kind, name, (node, self.node_uris.get(node, ""))) for kind, name, node in rows(self))


def rows(registrations: object) -> Iterator[Row]:
    """All registrations of a State or a View."""
    for kind in KINDS:
        for name, nodes in getattr(registrations, f"{kind}s").items():
            for node in nodes:
                yield kind, name, node


# Entries of /diagnostics (REP 107)

OK, WARN, ERROR = range(3)  # levels of diagnostic_msgs/DiagnosticStatus
PREFIX = "multimaster: "  # of all names: an analyzer of diagnostic_aggregator finds them by it
VALUES = 200  # of an entry of /diagnostics


class DiagnosticEntry(NamedTuple):
    """An entry of /diagnostics."""

    name: str
    message: str
    values: List[Tuple[str, str]]
    level: int = OK


def warning(name: str, why: str, values: List[Tuple[str, str]]) -> DiagnosticEntry:
    """An entry that is a warning if it has values, of which not too many are shown."""
    if not values:
        return DiagnosticEntry(PREFIX + name, "OK", [])
    more = [("more", f"{len(values) - VALUES} are not listed here")] if len(values) > VALUES else []
    return DiagnosticEntry(PREFIX + name, why, values[:VALUES] + more, WARN)
