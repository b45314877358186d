# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""What is done after a sign of a peer: the acts of the table LIFE in peer.py, each carried out."""

from typing import Callable, Dict, Optional

from ...protocol.members import Members
from ...protocol.plain_text import quote
from .actions import Outbox
from .outsiders import Outsiders
from .peer import Act, Contact, Key, Peer, Sign
from .peers import MAX_MASTERS, MAX_PER_ADDRESS, News, Peers
from .strangers import FORGET_STRANGER, Strangers
from .view import View

CONTACT_RETRY = 5.0  # seconds
CONTACT_RETRY_NO_STATE = 1.0  # seconds: it answered that it has no state yet


class Life:
    """Changes the state of peers, and does what follows."""

    def __init__(
        self, members: Members, outsiders: Outsiders, peers: Peers, strangers: Strangers, view: View, outbox: Outbox
    ) -> None:
        self._members, self._outsiders, self._peers = members, outsiders, peers
        self._strangers, self._view, self._outbox = strangers, view, outbox
        self.acts: Dict[Act, Callable[[Peer, News], None]] = {
            Act.NOTHING: lambda _peer, _news: None,
            Act.ADMIT: self._admit,
            Act.IDENTIFY: self._identify,
            Act.ASK_LATER: self._ask_later,
            Act.WAIT_FOR_ROOM: self._wait_for_room,
            Act.CHECK: lambda peer, news: peers.check(peer, news.now),
            Act.CHECK_AGAIN: lambda peer, news: peers.check_again(peer, news.contact is not None, news.now),
            Act.KEEP: self._keep,
            Act.REFUSE: self._refuse,
            Act.EXPEL: self._refuse,
            Act.DROP: lambda peer, _news: peers.drop(peer),
        }

    def move(self, entry: Peer, sign: Sign, news: News) -> None:
        """Change the state of a peer, and do what its table says."""
        self.acts[entry.move(sign)](entry, news)

    def sign_of(self, entry: Peer, contact: Optional[Contact], gone: bool) -> Sign:
        """What an answer over TCP is a sign of. `gone`: it was answered that there is no master."""
        last = self._peers.is_last_check(entry)
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

    def _admit(self, entry: Peer, news: News) -> None:
        """List a stranger."""
        self._peers.add(self._strangers.table.pop(entry.key))
        self._identify(entry, news)

    def _identify(self, entry: Peer, news: News) -> None:
        known, contact = entry.contact, news.contact
        if contact is None:
            return
        self._peers.identify(entry, contact, news)
        if known is None or known.uri != contact.uri:
            self._view.report_twins(entry, contact)

    def _ask_later(self, entry: Peer, news: News) -> None:
        entry.contact_due = news.now + (CONTACT_RETRY_NO_STATE if news.starting else CONTACT_RETRY)
        entry.credit, entry.failures = 0, entry.failures + 1
        if entry.contact is None:
            few = len(self._strangers.table) <= MAX_PER_ADDRESS
            text = f"{entry.monitor_uri} is heard, but does not say who it is: {quote(news.problem)}"
            self._outbox.say("warning", f"contact {entry.key[0]}" if few else "contacts", text)

    def _wait_for_room(self, entry: Peer, _news: News) -> None:
        text = f"{entry.monitor_uri} is ignored: {MAX_MASTERS} masters are known already"
        self._outbox.say("warning", "masters", text)
        entry.contact_due = entry.contacted + FORGET_STRANGER

    def _refuse(self, entry: Peer, news: News) -> None:
        """Exchange nothing with a master that is not what it says. Its heartbeats are still heard."""
        if news.contact is not None:
            self._outsiders.refuse(entry.key, news.contact, self.objection(entry.key, news.contact), news.now)
        self._peers.drop(entry)
        entry.contact_due = news.now + FORGET_STRANGER

    def _keep(self, entry: Peer, _news: News) -> None:
        name = entry.contact.name if entry.contact is not None else entry.monitor_uri
        text = f"{name} was said to leave, but answers at {entry.monitor_uri}: kept"
        self._outbox.say("warning", f"leave {entry.key[0]}", text)
