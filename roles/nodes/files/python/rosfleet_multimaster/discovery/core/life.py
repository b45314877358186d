# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The life of a peer: the meaning of its answers over TCP, and the reaction to a datagram that says that it leaves.

A peer is a newcomer until it says who it is (`Peer.contact`). Then it is online or not: its heartbeats and its silence decide
(peers.py). It may also be asked whether it has left (`Peer.checks`): anybody can write a LEAVE.
"""

from typing import Optional

from ...protocol.heartbeat import Kind
from ...protocol.members import Members
from ...protocol.plain_text import quote
from .actions import ActionOutbox
from .newcomers import FORGET_NEWCOMER, Newcomers
from .outsiders import Outsiders
from .peer import Contact, Key, Peer
from .peers import MAX_MASTERS, MAX_PER_ADDRESS, News, Peers
from .view import MasterView

LEAVE_CHECKS = (0.2, 1.0, 3.0)  # seconds: a peer that still answers after these has not left
LEAVE_PAUSE = 1.0  # seconds between a contact and the first check of another LEAVE
CONTACT_RETRY = 5.0  # seconds
CONTACT_RETRY_NO_STATE = 1.0  # seconds: it answered that it has no state yet


class Life:
    """Takes the answers of peers, and their leave."""

    def __init__(
        self,
        members: Members,
        outsiders: Outsiders,
        peers: Peers,
        newcomers: Newcomers,
        view: MasterView,
        outbox: ActionOutbox,
    ) -> None:
        self._members, self._outsiders, self._peers = members, outsiders, peers
        self._newcomers, self._view, self._outbox = newcomers, view, outbox

    def leave(self, entry: Peer, now: float) -> None:
        """Ask a peer over TCP whether it has left."""
        if not entry.is_leaving:
            entry.checks = 1
            entry.contact_due = max(now + LEAVE_CHECKS[0], entry.contacted + LEAVE_PAUSE)

    def take_answer(self, entry: Peer, news: News) -> None:
        """Take an answer over TCP, or that there was no answer."""
        refusal = self.find_refusal(entry.key, news.contact)
        if news.contact is not None and refusal:
            self._refuse(entry, news.contact, refusal, news.now)
        elif entry.contact is None:
            self._take_newcomer(entry, news)
        elif entry.is_leaving:
            self._take_check(entry, news)
        elif news.contact is not None:
            self._identify(entry, news.contact, news)
        elif entry.online:
            self._ask_later(entry, news)

    def find_refusal(self, key: Key, contact: Optional[Contact]) -> str:
        """The reason for exchanging nothing with a master that answers so; empty if it may be exchanged with."""
        return "" if contact is None else self._members.find_refusal(contact.uri, contact.name, key[0])

    def _refuse(self, entry: Peer, contact: Contact, refusal: str, now: float) -> None:
        """Exchange nothing with a master with wrong claims, and ask it again much later. Its heartbeats are still heard."""
        self._outsiders.refuse(entry.key, contact, refusal, now)
        self._peers.drop(entry, now)
        entry.contact_due = now + FORGET_NEWCOMER

    def _take_newcomer(self, entry: Peer, news: News) -> None:
        """List a newcomer that has said who it is, if there is room."""
        if news.contact is None:
            self._ask_later(entry, news)
        elif self._peers.has_room(entry):
            self._peers.add(self._newcomers.table.pop(entry.key))
            self._identify(entry, news.contact, news)
        else:
            text = f"{entry.monitor_uri} is ignored: {MAX_MASTERS} masters are known already"
            self._outbox.say("warning", "masters", text)
            entry.contact_due = entry.contacted + FORGET_NEWCOMER

    def _identify(self, entry: Peer, contact: Contact, news: News) -> None:
        """Remember who a peer is. It answers, so it is online."""
        known, entry.online = entry.contact, True
        self._peers.identify(entry, contact, news)
        if known is None or known.uri != contact.uri:
            self._view.report_twins(entry, contact)

    def _ask_later(self, entry: Peer, news: News) -> None:
        """Ask over TCP again after a while."""
        entry.contact_due = news.now + (CONTACT_RETRY_NO_STATE if news.starting else CONTACT_RETRY)
        entry.credit, entry.failures = 0, entry.failures + 1
        if entry.contact is None:
            few = len(self._newcomers.table) <= MAX_PER_ADDRESS
            text = f"{entry.monitor_uri} is heard, but does not say who it is: {quote(news.problem)}"
            self._outbox.say("warning", f"contact {entry.key[0]}" if few else "contacts", text)

    def _take_check(self, entry: Peer, news: News) -> None:
        """Ask once more whether a peer has left: soon if it did not answer, later if it did. The last check decides."""
        last = entry.checks == len(LEAVE_CHECKS)
        if news.contact is None and (last or news.gone):
            self._peers.drop(entry, news.now)
        elif last:
            entry.checks = 0
            name = entry.contact.name if entry.contact is not None else entry.monitor_uri
            text = f"{name} was said to leave, but answers at {entry.monitor_uri}: kept"
            self._outbox.say("warning", f"leave {entry.key[0]}", text)
        else:
            entry.contact_due = news.now + LEAVE_CHECKS[0 if news.contact is None else entry.checks]
            entry.checks += 1
            self._outbox.send(self._peers.local.record(Kind.REQUEST), entry.key[0])
