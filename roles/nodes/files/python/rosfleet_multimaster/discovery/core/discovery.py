# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Discovery of one master: datagrams and times in, datagrams and events out.

Theory of operation
-------------------
Each robot announces its own master by heartbeats: to a multicast group, to the hosts that are named, or to both. A
heartbeat says when the state of the master changed last (its stamp), and on which port its XML-RPC server answers. It
does not say who the master is.

So a new sender is a newcomer first. It is asked over TCP who it is. A datagram can name any sender, so
the number of newcomers is bounded, only a few are asked at a time, and silent ones are forgotten.
A sender that answers becomes a peer, and others hear of it: `Event("new")`. If the fleet is known (members.py), only
its robots at their planned addresses and allowed strangers become peers; the rest are outsiders (outsiders.py).

A peer that is silent for longer than it promised is asked by datagrams, then over TCP, and then it is offline. It stays
listed, so that it is online again with its first heartbeat, and is removed after ~remove_after. A LEAVE says that a
peer goes. A LEAVE can be forged too: the peer is asked several times over TCP, and stays if it answers (life.py).

The own master is announced several times after each change, since one lost datagram must not delay it. While the own
roscore does not answer, nothing is announced, and after a while its leaving is announced.

So there are the own state (local_master.py, and announcements.py: its announcements), the newcomers (newcomers.py),
the peers (peers.py) and the view that others have of all masters (view.py). `Discovery` hands their input on.

There are no sockets, threads and clocks here: every time is an argument, in seconds of a clock that never steps. An action that is
to be done waits in `Discovery.actions`. The program takes it from there, in one place, and carries it out.
"""

from typing import Container, Iterable, Optional, Tuple

from ...protocol.heartbeat import Heartbeat, InvalidHeartbeat, Kind, decode
from ...protocol.members import Members
from ...protocol.messages import AnnouncedMaster
from ...protocol.parameters import Settings
from .actions import ActionOutbox
from .announcements import Announcements
from .life import Life
from .local_master import LocalMaster
from .newcomers import Newcomers
from .outsiders import Outsiders
from .peer import FAR, LONG_AGO, Contact, Key, Peer
from .peers import News, Peers
from .view import MasterView

SCAN, EARLY = 1.0, 0.5  # seconds between two ticks at most; and the tidying may come so much before its time
ASLEEP = 1.5  # seconds between two ticks after which this computer was asleep, and the others were not silent
DEAD_AFTER, LEAVE_AFTER = 1.0, 5.0  # seconds without the own roscore: it is offline; the others are asked to forget it


class Discovery:
    """The discovery of one master."""

    def __init__(
        self, settings: Settings, own_addresses: Iterable[str], rpc_port: int, members: Optional[Members] = None
    ) -> None:
        self.members = Members() if members is None else members
        self.malformed = 0
        self.local = LocalMaster(settings, own_addresses, rpc_port, self.members)
        self._outbox = ActionOutbox(self.local.is_own)
        self.actions = self._outbox.actions
        self.outsiders = Outsiders(self._outbox)
        self.peers = Peers(settings, self.members, self.local, self._outbox)
        self.newcomers = Newcomers(self.members, self.outsiders, self._outbox)
        self.announcements = Announcements(settings, self.local, self.peers, self._outbox)
        self.view = MasterView(settings, self.members, self.local, self.peers, self._outbox)
        self.life = Life(self.members, self.outsiders, self.peers, self.newcomers, self.view, self._outbox)
        self._ticked = FAR
        self._next_scan = 0.0

    # The calls of the program

    def take_own_state(self, master: AnnouncedMaster, now: float) -> None:
        """Take the state of the own master: its roscore answers. A changed state is announced, several times."""
        self.peers.mark_stale()
        self.announcements.take(self.local.take(master, now), master, now)
        self.view.publish(self._ticked)
        self.tick(now)

    def note_silent_roscore(self, since: float, now: float) -> bool:
        """Note that the roscore gives no answer since `since`. True if it counts as offline by now."""
        if now - since <= DEAD_AFTER:
            return False
        if self.local.online:
            self.peers.mark_stale()
            self.local.lose()
            self.announcements.stop()
            self.view.publish(self._ticked)
        if self.local.master is not None and now - since >= LEAVE_AFTER:
            self.announcements.say_gone(now)
        self.tick(now)
        return True

    def take_networks(self, networks: Container[str]) -> None:
        """Take the networks of this computer. If the fleet is known, a sender outside them is not asked who it is."""
        self.local.networks = networks if self.members.robots else None

    def take_addresses(self, own_addresses: Iterable[str]) -> None:
        """Take the new addresses of this computer: a peer at one of them is this node itself."""
        self.peers.mark_stale()
        self.local.addresses = frozenset(own_addresses)
        for table in (self.peers.table, self.newcomers.table):
            for key in [key for key in table if self.local.is_this_node(key[0], key[2])]:
                del table[key]
        self.view.publish(self._ticked)

    def refresh(self, now: float) -> None:
        """Ask all masters for their state now."""
        self.announcements.refresh(now)
        self.tick(now)

    def datagram(self, data: bytes, source: Tuple[str, int], multicast: bool, now: float) -> None:
        """Take a datagram. An empty one is a probe of a verification."""
        if not data:
            return
        try:
            beat = decode(data)
        except InvalidHeartbeat as problem:
            self.malformed += 1
            text = f"a datagram from {source[0]}:{source[1]} is ignored: {problem}"
            self._outbox.say("warning", "malformed", text)
            return
        if self.local.is_this_node(source[0], beat.rpc_port):
            if beat.kind is Kind.STATE:
                self.local.beats.append(now)
            return
        planned = self.members.is_discovery(source[0], beat.rpc_port)
        if not planned and not self.local.admits(source[0]):
            if beat.kind is not Kind.LEAVE:
                self.outsiders.hear(source[0], beat.rpc_port, now, self.local.may_ask(source[0]))
                self.newcomers.meet(now)
            return
        key = (source[0], 0 if planned else source[1], beat.rpc_port)
        if beat.kind is Kind.REQUEST:
            self.announcements.answer(source[0], multicast, now)
        entry = self.peers.table.get(key)
        if entry is not None:
            self._hear(entry, beat, now)
        elif beat.kind is not Kind.LEAVE:
            self.newcomers.hear(key, beat, now)

    def _hear(self, entry: Peer, beat: Heartbeat, now: float) -> None:
        if beat.kind is Kind.LEAVE:
            self.peers.mark_stale()
            self.life.leave(entry, now)
            return
        before = entry.outlook()
        self.peers.hear(entry, beat, now)
        if entry.outlook() != before:
            self.peers.mark_stale()  # listed with the next tick: if many masters meet, many datagrams are read at once

    def take_contact(
        self,
        key: Key,
        contact: Optional[Contact],
        problem: str,
        now: float,
        *,
        gone: bool = False,
        fault: bool = False,
    ) -> bool:
        """Take the result of an Ask: the answer, or None and why. True if it is a master that is listed.

        `gone`: it was answered that there is no master, `fault`: by a discovery node.
        """
        self.peers.mark_stale()
        # A closed port is no answer of a discovery node.
        self.newcomers.end_question(key, answered=contact is not None or fault)
        entry = self.peers.table.get(key) or self.newcomers.table.get(key)
        if entry is None:
            other = f"its discovery answers at port {key[2]}, which is not the planned one"
            self.outsiders.take_answer(key, contact, self.life.find_refusal(key, contact) or other, now)
            self.newcomers.meet(now)
            return False
        asked, entry.asked, entry.contacted, entry.contact_due = entry.asked, None, now, FAR
        if contact is None and not fault:
            entry.failed = now
        starting = contact is not None and contact.stamp <= 0.0
        if starting:
            contact, problem = None, "it has no state yet"
        if contact is not None:
            entry.heard = now
        self.life.take_answer(entry, News(now, contact, problem, starting, gone, LONG_AGO if asked is None else asked))
        self.view.publish(self._ticked)
        self.newcomers.meet(now)
        return contact is not None and key in self.peers.table

    def tick(self, now: float) -> None:
        """Do all that is due; at least once a second."""
        late, self._ticked = now - self._ticked, now
        if late > ASLEEP:
            self.peers.wake(late - SCAN, now)
        self.announcements.tick(now)
        self.peers.step(now)
        if now >= self._next_scan - EARLY:  # rather now than to wake for it
            self._next_scan = now + SCAN
            self.announcements.tidy(now)
            self.newcomers.forget(now)
        if self.peers.stale:
            self.view.publish(now)
        self.newcomers.meet(now)

    # The questions of the program

    def next_tick(self) -> float:
        """The time at which `tick` has something to do."""
        return min([self._next_scan, self.peers.next_step(), *self.newcomers.due(), *self.announcements.due()])
