# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The life of a peer, as a table: state and sign in, next state and act out.

A peer is a sender of heartbeats: an address, a UDP port and an XML-RPC port. `LIFE` says all that can happen to one.
Nothing here knows what an act does; that is in life.py.
"""

from collections import deque
from dataclasses import dataclass, field
from enum import Enum
from typing import Any, Deque, Dict, Mapping, NamedTuple, Optional, Tuple
from urllib.parse import urlsplit

from ...protocol.heartbeat import Heartbeat
from ...protocol.messages import Master
from ...protocol.plain_text import is_plain, quote

Key = Tuple[str, int, int]  # address and UDP port of the sender, port of its XML-RPC server
LONG_AGO = float("-inf")
MAX_NAME = 1024  # characters of a name or URI in an answer


class State(Enum):
    """The state of a peer."""

    STRANGER = "it sends heartbeats, and has not said yet who it is"
    ONLINE = "it has said who it is, and is heard"
    OFFLINE = "it is silent"
    LEAVING = "it was online; a datagram says that it leaves, which anybody can write: it is asked"
    LEAVING_OFFLINE = "the same, and it is silent too"
    REMOVED = "it is forgotten"


class Sign(Enum):
    """An event in the life of a peer."""

    HEARD = "a heartbeat of a peer whose state has a stamp"
    HEARD_EMPTY = "a heartbeat of a peer that has no state yet"
    LEAVE = "a datagram says that it leaves"
    ANSWER = "it answered over TCP who it is"
    LAST_ANSWER = "the same, to the last check after a LEAVE"
    NO_ROOM = "it answered, but too many peers are known"
    FOREIGN = "it answered as a master that does not belong to the fleet, or not at this address"
    NO_ANSWER = "it did not answer over TCP, or has no state yet"
    LAST_NO_ANSWER = "the same, at the last check after a LEAVE"
    REFUSAL = "its computer answered over TCP that no master is there"
    SILENCE = "it was not heard for too long"
    LONG_SILENCE = "it was not heard for ~remove_after"


class Act(Enum):
    """The reaction to a sign."""

    NOTHING = "nothing"
    ADMIT = "list it among the masters, and remember who it is"
    IDENTIFY = "remember who it is"
    ASK_LATER = "ask over TCP again after a while"
    WAIT_FOR_ROOM = "ask over TCP again after a longer while"
    CHECK = "ask over TCP whether it has left"
    CHECK_AGAIN = "ask once more: soon where it did not answer, later where it did"
    KEEP = "say that it has not left"
    REFUSE = "tell of it as one that is ignored, and ask it again much later"
    EXPEL = "the same, and forget that it was a master"
    DROP = "forget it"


_LEAVING = {
    Sign.LEAVE: Act.NOTHING,
    Sign.ANSWER: Act.CHECK_AGAIN,
    Sign.NO_ANSWER: Act.CHECK_AGAIN,
}

#: state -> sign -> next state, act. A sign that is missing cannot happen in that state. (Heartbeats of strangers are
#: only counted, and a silent one is forgotten: see `Strangers`.)
LIFE: Mapping[State, Mapping[Sign, Tuple[State, Act]]] = {
    State.STRANGER: {
        Sign.ANSWER: (State.ONLINE, Act.ADMIT),
        Sign.NO_ROOM: (State.STRANGER, Act.WAIT_FOR_ROOM),
        Sign.FOREIGN: (State.STRANGER, Act.REFUSE),
        Sign.NO_ANSWER: (State.STRANGER, Act.ASK_LATER),
        Sign.REFUSAL: (State.STRANGER, Act.ASK_LATER),
    },
    State.ONLINE: {
        Sign.HEARD: (State.ONLINE, Act.NOTHING),
        Sign.HEARD_EMPTY: (State.ONLINE, Act.NOTHING),
        Sign.LEAVE: (State.LEAVING, Act.CHECK),
        Sign.ANSWER: (State.ONLINE, Act.IDENTIFY),
        Sign.NO_ANSWER: (State.ONLINE, Act.ASK_LATER),
        Sign.REFUSAL: (State.ONLINE, Act.ASK_LATER),
        Sign.SILENCE: (State.OFFLINE, Act.NOTHING),
        Sign.FOREIGN: (State.REMOVED, Act.EXPEL),
        Sign.LONG_SILENCE: (State.REMOVED, Act.DROP),
    },
    State.OFFLINE: {
        Sign.HEARD: (State.ONLINE, Act.NOTHING),
        Sign.HEARD_EMPTY: (State.OFFLINE, Act.NOTHING),
        Sign.LEAVE: (State.LEAVING_OFFLINE, Act.CHECK),
        Sign.ANSWER: (State.ONLINE, Act.IDENTIFY),
        Sign.NO_ANSWER: (State.OFFLINE, Act.NOTHING),
        Sign.REFUSAL: (State.OFFLINE, Act.NOTHING),
        Sign.FOREIGN: (State.REMOVED, Act.EXPEL),
        Sign.LONG_SILENCE: (State.REMOVED, Act.DROP),
    },
    State.LEAVING: {
        Sign.HEARD: (State.ONLINE, Act.NOTHING),
        Sign.HEARD_EMPTY: (State.ONLINE, Act.NOTHING),
        **{sign: (State.LEAVING, act) for sign, act in _LEAVING.items()},
        Sign.LAST_ANSWER: (State.ONLINE, Act.KEEP),
        Sign.LAST_NO_ANSWER: (State.REMOVED, Act.DROP),
        Sign.REFUSAL: (State.REMOVED, Act.DROP),
        Sign.SILENCE: (State.LEAVING_OFFLINE, Act.NOTHING),
        Sign.FOREIGN: (State.REMOVED, Act.EXPEL),
        Sign.LONG_SILENCE: (State.REMOVED, Act.DROP),
    },
    State.LEAVING_OFFLINE: {
        Sign.HEARD: (State.ONLINE, Act.NOTHING),
        Sign.HEARD_EMPTY: (State.OFFLINE, Act.NOTHING),
        **{sign: (State.LEAVING_OFFLINE, act) for sign, act in _LEAVING.items()},
        Sign.LAST_ANSWER: (State.OFFLINE, Act.KEEP),
        Sign.LAST_NO_ANSWER: (State.REMOVED, Act.DROP),
        Sign.REFUSAL: (State.REMOVED, Act.DROP),
        Sign.FOREIGN: (State.REMOVED, Act.EXPEL),
        Sign.LONG_SILENCE: (State.REMOVED, Act.DROP),
    },
    State.REMOVED: {},
}


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
        if not uri.startswith("http://") or not urlsplit(uri).hostname:
            raise ValueError(f"it calls its master {quote(uri)}")
        return cls(stamp, uri, name, discoverer)

    @property
    def host(self) -> str:
        """The host that the master calls its own."""
        return urlsplit(self.uri).hostname or ""


def find_name_problem(contact: Contact, heard: str, address: str, there: Optional[Contact]) -> str:
    """The reason why the nodes of a master cannot be reached by its name; empty where they can.

    `heard` is the address that it sends from, `address` that of its name ("" for none), `there` the contact that answers at the latter.
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
        f"{contact.host} resolves to {address}, where {contact.name} does not answer, and {contact.name} is heard from"
        f" {heard}: its topics may be silent"
    )


@dataclass
class Peer:
    """One sender. A robot that is heard from two addresses is two peers."""

    key: Key
    since: float
    heard: float  # its last sign of life
    beat: Heartbeat
    contact: Optional[Contact] = None  # none yet: a stranger
    state: State = State.STRANGER
    credit: int = 0  # datagrams since it was last asked in vain who it is,
    failures: int = 0  # and how often it was
    requested: float = LONG_AGO  # when its state was asked for by a datagram
    probed: float = LONG_AGO  # when it was asked over TCP, since it was silent
    contact_due: Optional[float] = None
    asked: Optional[float] = None  # since when an answer over TCP is awaited
    contacted: float = LONG_AGO
    checks: int = 0  # checks after a LEAVE that were begun
    failed: float = LONG_AGO  # when it did not answer over TCP
    rate: float = 0.0  # heartbeats that it promises a second, as far as a contact has confirmed them
    promises: Dict[float, float] = field(default_factory=dict)  # rate in its heartbeats -> when one was heard last
    beats: Deque[float] = field(default_factory=lambda: deque(maxlen=512))

    @property
    def online(self) -> bool:
        """True while others are told that it is online."""
        return self.state in (State.ONLINE, State.LEAVING)

    @property
    def is_leaving(self) -> bool:
        """True while it is checked whether it has left."""
        return self.state in (State.LEAVING, State.LEAVING_OFFLINE)

    def move(self, sign: Sign) -> Act:
        """Change the state after a sign, and return what is to be done."""
        self.state, act = LIFE[self.state][sign]
        if not self.is_leaving:
            self.checks = 0
        return act

    @property
    def monitor_uri(self) -> str:
        """The address of its XML-RPC server."""
        return f"http://{self.key[0]}:{self.key[2]}"

    def highest_rate(self, since: float) -> float:
        """The highest rate of its heartbeats since a time: a lower one can be forged."""
        return max((rate for rate, heard in self.promises.items() if heard >= since), default=self.beat.rate)

    @property
    def unreachable(self) -> bool:
        """True where it did not answer over TCP, and has not been heard since."""
        return self.failed > self.heard

    @property
    def overdue(self) -> bool:
        """True where it was asked for its state and has not been heard since."""
        return self.requested > self.heard

    def outlook(self) -> Tuple[Any, ...]:
        """All that the view of others and the next steps depend on, but for the time of the last sign of life."""
        silent = (self.overdue, self.unreachable, self.probed < self.heard)
        return (self.beat.stamp, self.beat.local_stamp, self.state, self.rate, self.contact_due, self.contact, silent)

    def master(self) -> Master:
        """The master as others are told of it; not for a stranger."""
        stamp, local = self.beat.stamp.seconds, self.beat.local_stamp.seconds
        contact = self.contact or Contact(0.0, "", "", "")
        return Master(contact.name, contact.uri, self.monitor_uri, contact.discoverer, stamp, local, self.online)
