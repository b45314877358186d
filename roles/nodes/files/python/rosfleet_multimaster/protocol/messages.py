# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""What the messages and services of ROS say of masters, links and registrations, as the nodes have it.

edge/ros.py makes these of messages, and messages of these.
"""

from dataclasses import dataclass
from typing import NamedTuple, Tuple

from .plain_text import quoted

NodeKey = Tuple[str, str]  # name and URI of a node


@dataclass(frozen=True)
class Master:
    """A master as the topic and the service of discovery show it: `~changes`, `~list_masters`."""

    name: str
    uri: str
    stamp: float
    local_stamp: float
    online: bool
    discoverer: str
    monitor_uri: str


class Announced(NamedTuple):
    """A master as discovery announces it."""

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


class Registration(NamedTuple):
    """One registration of a node of another master."""

    kind: str  # publisher, subscriber, service
    name: str
    node: str
    node_uri: str
    service_uri: str = ""

    @property
    def of(self) -> NodeKey:
        """The node."""
        return self.node, self.node_uri

    def __str__(self) -> str:
        return f"{self.kind} {quoted(self.name)} of {quoted(self.node)}"
