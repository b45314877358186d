# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The life of a peer, as a table: state and sign in, next state and act out. `LIFE` says all that can happen to one."""

from typing import Callable, Mapping, Optional, Tuple

from ...protocol.heartbeat import Kind
from ...protocol.members import Members
from ...protocol.plain_text import quote
from .actions import Outbox
from .outsiders import Outsiders
from .peer import Contact, Key, Peer, Sign, State
from .peers import MAX_MASTERS, MAX_PER_ADDRESS, News, Peers
from .strangers import FORGET_STRANGER, Strangers
from .view import View

LEAVE_CHECKS = (0.2, 1.0, 3.0)  # seconds: a peer that still answers after these has not left
LEAVE_PAUSE = 1.0  # seconds between a contact and the first check of another LEAVE
CONTACT_RETRY = 5.0  # seconds
CONTACT_RETRY_NO_STATE = 1.0  # seconds: it answered that it has no state yet


class Life:
    """Changes the state of peers, and does what follows."""

    def __init__(
        self, members: Members, outsiders: Outsiders, peers: Peers, strangers: Strangers, view: View, outbox: Outbox
    ) -> None:
        self._members, self._outsiders, self._peers = members, outsiders, peers
        self._strangers, self._view, self._outbox = strangers, view, outbox

    def move(self, entry: Peer, sign: Sign, news: News) -> None:
        """Change the state of a peer, and do what its table says."""
        entry.state, act = LIFE[entry.state][sign]
        if not entry.is_leaving:
            entry.checks = 0
        if act is not None:
            act(self, entry, news)

    def sign_of(self, entry: Peer, contact: Optional[Contact], gone: bool) -> Sign:
        """What an answer over TCP is a sign of. `gone`: it was answered that there is no master."""
        last = entry.checks == len(LEAVE_CHECKS)  # this answer decides whether it has left
        if contact is None:
            return Sign.REFUSAL if gone else Sign.LAST_NO_ANSWER if last else Sign.NO_ANSWER
        if self.objection(entry.key, contact):
            return Sign.FOREIGN
        if entry.contact is None and not self._peers.has_room(entry):
            return Sign.NO_ROOM
        return Sign.LAST_ANSWER if last else Sign.ANSWER

    def objection(self, key: Key, contact: Optional[Contact]) -> str:
        """Why nothing is exchanged with a master that answers so; empty where there is no reason."""
        return "" if contact is None else self._members.objection(contact.uri, contact.name, key[0])

    def admit(self, entry: Peer, news: News) -> None:
        """List a stranger."""
        self._peers.add(self._strangers.table.pop(entry.key))
        self.identify(entry, news)

    def identify(self, entry: Peer, news: News) -> None:
        """Remember who a peer is."""
        known, contact = entry.contact, news.contact
        if contact is None:
            return
        self._peers.identify(entry, contact, news)
        if known is None or known.uri != contact.uri:
            self._view.report_twins(entry, contact)

    def ask_later(self, entry: Peer, news: News) -> None:
        """Ask over TCP again after a while."""
        entry.contact_due = news.now + (CONTACT_RETRY_NO_STATE if news.starting else CONTACT_RETRY)
        entry.credit, entry.failures = 0, entry.failures + 1
        if entry.contact is None:
            few = len(self._strangers.table) <= MAX_PER_ADDRESS
            text = f"{entry.monitor_uri} is heard, but does not say who it is: {quote(news.problem)}"
            self._outbox.say("warning", f"contact {entry.key[0]}" if few else "contacts", text)

    def wait_for_room(self, entry: Peer, _news: News) -> None:
        """Ask over TCP again after a longer while."""
        text = f"{entry.monitor_uri} is ignored: {MAX_MASTERS} masters are known already"
        self._outbox.say("warning", "masters", text)
        entry.contact_due = entry.contacted + FORGET_STRANGER

    def refuse(self, entry: Peer, news: News) -> None:
        """Exchange nothing with a master that is not what it says, and ask it again much later. Its heartbeats are still heard."""
        if news.contact is not None:
            self._outsiders.refuse(entry.key, news.contact, self.objection(entry.key, news.contact), news.now)
        self.drop(entry, news)
        entry.contact_due = news.now + FORGET_STRANGER

    def check(self, entry: Peer, news: News) -> None:
        """Ask over TCP whether a peer has left."""
        entry.checks = 1
        entry.contact_due = max(news.now + LEAVE_CHECKS[0], entry.contacted + LEAVE_PAUSE)

    def check_again(self, entry: Peer, news: News) -> None:
        """Ask once more: soon where it did not answer, later where it did."""
        entry.contact_due = news.now + LEAVE_CHECKS[0 if news.contact is None else entry.checks]
        entry.checks += 1
        self._outbox.send(self._peers.local.record(Kind.REQUEST), entry.key[0])

    def keep(self, entry: Peer, _news: News) -> None:
        """Say that a peer has not left, whatever a datagram says: it still answers."""
        name = entry.contact.name if entry.contact is not None else entry.monitor_uri
        text = f"{name} was said to leave, but answers at {entry.monitor_uri}: kept"
        self._outbox.say("warning", f"leave {entry.key[0]}", text)

    def drop(self, entry: Peer, _news: News) -> None:
        """Forget a peer."""
        self._peers.table.pop(entry.key, None)


Act = Callable[[Life, Peer, News], None]

#: state -> sign -> next state, act (None: nothing is to be done). A sign that is missing cannot happen in that state.
#: (Heartbeats of strangers are only counted, and a silent one is forgotten: see `Strangers`.)
LIFE: Mapping[State, Mapping[Sign, Tuple[State, Optional[Act]]]] = {
    State.STRANGER: {
        Sign.ANSWER: (State.ONLINE, Life.admit),
        Sign.NO_ROOM: (State.STRANGER, Life.wait_for_room),
        Sign.FOREIGN: (State.STRANGER, Life.refuse),
        Sign.NO_ANSWER: (State.STRANGER, Life.ask_later),
        Sign.REFUSAL: (State.STRANGER, Life.ask_later),
    },
    State.ONLINE: {
        Sign.HEARD: (State.ONLINE, None),
        Sign.HEARD_EMPTY: (State.ONLINE, None),
        Sign.LEAVE: (State.LEAVING, Life.check),
        Sign.ANSWER: (State.ONLINE, Life.identify),
        Sign.NO_ANSWER: (State.ONLINE, Life.ask_later),
        Sign.REFUSAL: (State.ONLINE, Life.ask_later),
        Sign.SILENCE: (State.OFFLINE, None),
        Sign.FOREIGN: (State.REMOVED, Life.refuse),
        Sign.LONG_SILENCE: (State.REMOVED, Life.drop),
    },
    State.OFFLINE: {
        Sign.HEARD: (State.ONLINE, None),
        Sign.HEARD_EMPTY: (State.OFFLINE, None),
        Sign.LEAVE: (State.LEAVING_OFFLINE, Life.check),
        Sign.ANSWER: (State.ONLINE, Life.identify),
        Sign.NO_ANSWER: (State.OFFLINE, None),
        Sign.REFUSAL: (State.OFFLINE, None),
        Sign.FOREIGN: (State.REMOVED, Life.refuse),
        Sign.LONG_SILENCE: (State.REMOVED, Life.drop),
    },
    State.LEAVING: {
        Sign.HEARD: (State.ONLINE, None),
        Sign.HEARD_EMPTY: (State.ONLINE, None),
        Sign.LEAVE: (State.LEAVING, None),
        Sign.ANSWER: (State.LEAVING, Life.check_again),
        Sign.NO_ANSWER: (State.LEAVING, Life.check_again),
        Sign.LAST_ANSWER: (State.ONLINE, Life.keep),
        Sign.LAST_NO_ANSWER: (State.REMOVED, Life.drop),
        Sign.REFUSAL: (State.REMOVED, Life.drop),
        Sign.SILENCE: (State.LEAVING_OFFLINE, None),
        Sign.FOREIGN: (State.REMOVED, Life.refuse),
        Sign.LONG_SILENCE: (State.REMOVED, Life.drop),
    },
    State.LEAVING_OFFLINE: {
        Sign.HEARD: (State.ONLINE, None),
        Sign.HEARD_EMPTY: (State.OFFLINE, None),
        Sign.LEAVE: (State.LEAVING_OFFLINE, None),
        Sign.ANSWER: (State.LEAVING_OFFLINE, Life.check_again),
        Sign.NO_ANSWER: (State.LEAVING_OFFLINE, Life.check_again),
        Sign.LAST_ANSWER: (State.OFFLINE, Life.keep),
        Sign.LAST_NO_ANSWER: (State.REMOVED, Life.drop),
        Sign.REFUSAL: (State.REMOVED, Life.drop),
        Sign.FOREIGN: (State.REMOVED, Life.refuse),
        Sign.LONG_SILENCE: (State.REMOVED, Life.drop),
    },
    State.REMOVED: {},
}
