# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Masters, links, registrations and entries of /diagnostics, as the messages and services of ROS carry them.

edge/ros.py converts both ways.
"""

from typing import List, NamedTuple, Tuple

from .plain_text import quote

NodeKey = Tuple[str, str]  # name and URI of a node


class Master(NamedTuple):
    """A master, as discovery announces it (`~changes`) and lists it (`~list_masters`)."""

    name: str
    uri: str
    monitor_uri: str
    discoverer: str
    stamp: float
    local_stamp: float
    online: bool


class Link(NamedTuple):
    """The quality of the link to a master: per cent of the expected heartbeats, -1 where none are promised."""

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


# Entries of /diagnostics (REP 107)

OK, WARN, ERROR = range(3)  # levels of diagnostic_msgs/DiagnosticStatus
PREFIX = "multimaster: "  # of all names: an analyzer of diagnostic_aggregator finds them by it
VALUES = 200  # of an entry of /diagnostics


class Diagnosis(NamedTuple):
    """An entry of /diagnostics."""

    name: str
    message: str
    values: List[Tuple[str, str]]
    level: int = OK


def warning(name: str, why: str, values: List[Tuple[str, str]]) -> Diagnosis:
    """An entry that is a warning where it has values, of which not too many are shown."""
    if not values:
        return Diagnosis(PREFIX + name, "OK", [])
    more = [("more", f"{len(values) - VALUES} are not listed here")] if len(values) > VALUES else []
    return Diagnosis(PREFIX + name, why, values[:VALUES] + more, WARN)
