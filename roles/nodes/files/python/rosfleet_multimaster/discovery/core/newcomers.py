# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Newcomers: senders whose master is not known yet. A datagram can name any sender, so there may be many."""

from typing import Dict, List, Set

from ...protocol.heartbeat import Heartbeat, Kind
from ...protocol.members import Members
from .actions import NEWCOMER_LIMIT, ActionOutbox
from .outsiders import ConnectionBudget, Outsiders
from .peer import FAR, Key, Peer

MAX_NEWCOMERS, MAX_ASKED = 1024, 32  # senders whose master is not known yet; those that are asked at the same time
FORGET_NEWCOMER = 30.0  # seconds of silence


class Newcomers:
    """The table of the newcomers, and those that are being asked."""

    def __init__(self, members: Members, outsiders: Outsiders, outbox: ActionOutbox) -> None:
        self.table: Dict[Key, Peer] = {}  # in the order in which they were last heard
        self._members, self._outsiders, self._outbox = members, outsiders, outbox
        self._asked: Set[Key] = set()  # those that are being asked who they are
        self._budget = ConnectionBudget()
        self._turn = False

    def hear(self, key: Key, beat: Heartbeat, now: float) -> None:
        """Take a heartbeat of a newcomer."""
        entry = self.table.pop(key, None)
        if entry is None:
            entry = Peer(key, now, now, beat, contact_due=now)
            if len(self.table) >= MAX_NEWCOMERS:
                text = f"{MAX_NEWCOMERS} senders do not say who they are: the first are forgotten"
                self._outbox.say("warning", "full", text)
                del self.table[next(first for first in self.table if first not in self._asked)]
        self.table[key] = entry
        entry.heard, entry.credit = now, entry.credit + 1
        if entry.contact_due == FAR and entry.asked is None and self._free(entry, now) <= now:
            entry.contact_due = now
        if beat.kind is Kind.STATE:
            entry.beat = beat
            entry.promises[beat.rate] = now
            entry.beats.append(now)
        self.meet(now)

    def end_question(self, key: Key, answered: bool) -> None:
        """Note that a question has ended. `answered`: by a discovery node."""
        self._asked.discard(key)
        if answered:
            self._budget.refund(key[0])

    def forget(self, now: float) -> None:
        """Forget those that have been silent for long."""
        self._outsiders.forget(now)
        while self.table and now - next(iter(self.table.values())).heard > FORGET_NEWCOMER:
            self.table.pop(next(iter(self.table)))

    def meet(self, now: float) -> None:
        """Ask newcomers who they are, not too many at a time.

        A flood may always have new senders: so the one that is heard most comes first. It may repeat the same ones:
        so every second time, the one that was asked least comes first.
        """
        for key in self._outsiders.due(now):
            self._outbox.ask_newcomer(key)
        while len(self._asked) < MAX_ASKED:
            waiting = [entry for entry in self.table.values() if entry.asked is None and entry.contact_due <= now]
            if not waiting:
                return
            self._turn = not self._turn
            entry = max(waiting, key=lambda entry: (-entry.failures if self._turn else 0, entry.credit))
            if self._free(entry, now) > now:
                entry.contact_due = FAR  # until it is heard after that time
                continue
            self._budget.spend(entry.key[0], now)
            self._asked.add(entry.key)
            self._outbox.ask(entry, now, NEWCOMER_LIMIT)

    def due(self) -> List[float]:
        """The times of the next questions."""
        room = len(self._asked) < MAX_ASKED
        times = [entry.contact_due for entry in self.table.values() if room and entry.asked is None]
        return [*times, self._outsiders.next_due()]

    def _free(self, entry: Peer, now: float) -> float:
        """The time from which a newcomer may be asked: twice, and later again, unless a member is planned there."""
        if self._members.is_discovery(entry.key[0], entry.key[2]):
            return now
        return self._budget.free(entry.key[0], now)
