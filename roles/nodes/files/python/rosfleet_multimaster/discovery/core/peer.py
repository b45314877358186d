# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""A peer: its key, its heartbeats, and the name that it gives itself. The events of one are in peers.py and life.py.

A peer is a sender of heartbeats: an address, a UDP port and an XML-RPC port.
"""

from collections import deque
from dataclasses import dataclass, field
from typing import Any, Deque, Dict, NamedTuple, Optional, Tuple

from ...protocol.heartbeat import Heartbeat
from ...protocol.messages import AnnouncedMaster
from ...protocol.plain_text import is_plain, quote
from ...protocol.tcpros.hosts import host_of

Key = Tuple[str, int, int]  # address and UDP port of the sender, port of its XML-RPC server
LONG_AGO, FAR = float("-inf"), float("inf")
MAX_NAME = 1024  # characters of a name or URI in an answer


class Contact(NamedTuple):
    """The answer of another discovery node to masterContacts: who it is."""

    stamp: float
    uri: str
    name: str
    discoverer: str

    @classmethod
    def from_answer(cls, answer: Any) -> "Contact":
        """Read an answer; the sender may be hostile. Raises ValueError."""
        if not isinstance(answer, list) or len(answer) < 4 or not all(isinstance(part, str) for part in answer[:4]):
            raise ValueError("it does not say who it is")
        stamp, (uri, name, discoverer) = float(answer[0]), answer[1:4]
        if not 0.0 <= stamp < 2**31:
            raise ValueError(f"its stamp is {answer[0][:40]}")
        for text in (uri, name, discoverer):
            if not is_plain(text, MAX_NAME) or " " in text or '"' in text:
                raise ValueError(f"a name that is none: {ascii(text[:40])}")
        if not uri.startswith("http://") or not host_of(uri):
            raise ValueError(f"it calls its master {quote(uri)}")
        return cls(stamp, uri, name, discoverer)

    @property
    def host(self) -> str:
        """The host that the master calls its own."""
        return host_of(self.uri)


def find_name_problem(contact: Contact, heard: str, address: str, there: Optional[Contact]) -> str:
    """The reason why the nodes of a master cannot be reached by its name; empty if they can.

    `heard` is the address that it sends from, `address` that of its name ("" without one), `there` the contact that answers at the latter.
    A gateway has two: its name leads to the one in the robot's network, and it is heard from the other.
    """
    if not address:
        return (
            f"{contact.name} calls its master {contact.uri}, but {contact.host} has no address on this computer: its"
            " topics will be silent"
        )
    if address == heard or (there is not None and there.uri == contact.uri):
        return ""
    return (
        f"{contact.host} resolves to {address}, at which {contact.name} does not answer, and {contact.name} is heard from"
        f" {heard}: its topics may be silent"
    )


@dataclass
class Peer:
    """One sender. A robot that is heard from two addresses is two peers."""

    key: Key
    since: float
    heard: float  # its last sign of life
    beat: Heartbeat
    contact: Optional[Contact] = None  # None: no contact yet, a newcomer
    online: bool = False  # others see that it is
    credit: int = 0  # datagrams since it was last asked in vain who it is,
    failures: int = 0  # and how often it was
    requested: float = LONG_AGO  # when its state was asked for by a datagram
    probed: float = LONG_AGO  # when it was asked over TCP, since it was silent
    contact_due: float = FAR  # when it is to be asked over TCP
    asked: Optional[float] = None  # since when an answer over TCP is awaited
    contacted: float = LONG_AGO
    checks: int = 0  # checks after a LEAVE that were begun; 0 while nothing says that it leaves
    failed: float = LONG_AGO  # when it did not answer over TCP
    rate: float = 0.0  # heartbeats that it promises a second, as far as a contact has confirmed them
    promises: Dict[float, float] = field(default_factory=dict)  # rate in its heartbeats -> when one was heard last
    beats: Deque[float] = field(default_factory=lambda: deque(maxlen=512))

    @property
    def is_leaving(self) -> bool:
        """True while it is checked whether it has left."""
        return self.checks > 0

    @property
    def monitor_uri(self) -> str:
        """The address of its XML-RPC server."""
        return f"http://{self.key[0]}:{self.key[2]}"

    def highest_rate(self, since: float) -> float:
        """The highest rate of its heartbeats since a time: a lower one can be forged."""
        return max((rate for rate, heard in self.promises.items() if heard >= since), default=self.beat.rate)

    @property
    def unreachable(self) -> bool:
        """True if it did not answer over TCP, and has not been heard since."""
        return self.failed > self.heard

    @property
    def overdue(self) -> bool:
        """True if it was asked for its state and has not been heard since."""
        return self.requested > self.heard

    def outlook(self) -> Tuple[Any, ...]:
        """All that the view of others and the next steps depend on, but for the time of the last sign of life."""
        silent = (self.overdue, self.unreachable, self.probed < self.heard)
        state = (self.beat.stamp, self.beat.local_stamp, self.online, self.is_leaving)
        return (*state, self.rate, self.contact_due, self.contact, silent)

    def master(self) -> AnnouncedMaster:
        """The master as others see it; not for a newcomer."""
        stamp, local = self.beat.stamp.seconds, self.beat.local_stamp.seconds
        contact = self.contact or Contact(0.0, "", "", "")
        return AnnouncedMaster(
            contact.name, contact.uri, self.monitor_uri, contact.discoverer, stamp, local, self.online
        )
