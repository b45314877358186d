# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The actions that discovery wants: they accumulate in an outbox, and the program carries them out."""

from collections import deque
from typing import Callable, Deque, NamedTuple, Optional, Union

from ...protocol.messages import AnnouncedMaster
from .peer import Key, Peer

CONTACT_LIMIT, NEWCOMER_LIMIT, LEAVE_LIMIT = 3.0, 1.5, 1.0  # seconds for an answer over TCP


class Send(NamedTuple):
    """Send a datagram to the group (host None) or to a host, always to the port of the protocol."""

    datagram: bytes
    host: Optional[str]


class Ask(NamedTuple):
    """Call masterContacts at a monitor URI and hand the result to `take_contact`."""

    key: Key
    monitor_uri: str
    limit: float  # seconds for the whole answer
    newcomer: bool  # its master is not known yet: it must not keep the others waiting


class MasterEvent(NamedTuple):
    """A master is new, changed or removed."""

    change: str
    master: AnnouncedMaster


class Say(NamedTuple):
    """A line for the log. Lines of one topic are limited in rate."""

    level: str  # info, warning, error
    topic: str
    text: str


Action = Union[Send, Ask, MasterEvent, Say]


class ActionOutbox:
    """The actions that wait for the program."""

    def __init__(self, is_own: Callable[[str], bool]) -> None:
        """`is_own(address)`: nothing is sent to this computer itself."""
        self.actions: Deque[Action] = deque()
        self._is_own = is_own

    def send(self, datagram: bytes, host: Optional[str]) -> None:
        """Have a datagram sent to a host, or to the group."""
        if host is None or not self._is_own(host):
            self.actions.append(Send(datagram, host))

    def ask(self, entry: Peer, now: float, limit: float = CONTACT_LIMIT) -> None:
        """Have a peer asked over TCP who it is, unless its answer is awaited already."""
        if entry.asked is None:
            entry.asked = now
            limit = LEAVE_LIMIT if entry.is_leaving else limit
            self.actions.append(Ask(entry.key, entry.monitor_uri, limit, entry.contact is None))

    def ask_newcomer(self, key: Key) -> None:
        """Have a sender asked over TCP who it is, of which nothing else is kept."""
        self.actions.append(Ask(key, f"http://{key[0]}:{key[2]}", NEWCOMER_LIMIT, True))

    def event(self, change: str, master: AnnouncedMaster) -> None:
        """Notify the other programs of this computer of a master."""
        self.actions.append(MasterEvent(change, master))

    def say(self, level: str, topic: str, text: str) -> None:
        """Have a line logged."""
        self.actions.append(Say(level, topic, text))
