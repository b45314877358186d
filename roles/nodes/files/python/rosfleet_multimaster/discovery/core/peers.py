# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The peers: senders that have said who they are. Their heartbeats, and the consequences if these stay away."""

from typing import Callable, Dict, Iterator, List, NamedTuple, Optional, Set, Tuple

from ...protocol.heartbeat import Heartbeat, Kind, Stamp
from ...protocol.members import Members
from ...protocol.parameters import Settings
from .actions import ActionOutbox
from .local_master import LocalMaster
from .peer import FAR, Contact, Key, Peer

MARGIN = 0.5  # of ~offline_after: the time that master_sync has to withdraw the registrations of a lost master
ASK_PAUSE = 0.2  # seconds between two requests to a master that missed its beat
SLOW_PAUSE, SLOW_PATIENCE = 1.0, 5.5  # seconds: the same for a master that promises few beats, and how long it is asked
RETURNED = (
    5.0  # seconds after the return of a robot of the fleet: its place identifies it, and its topics are wanted first
)
CONTACT_PAUSE = 5.0  # seconds between two contacts that nothing but requests of the other side ask for
MAX_MASTERS, MAX_PER_ADDRESS = 1024, 16  # more would be a flood

Step = Tuple[float, Callable[[Peer, float], None]]  # the time, and the action then


class Patience(NamedTuple):
    """The consequences of silence, in seconds since the last sign of life of a master."""

    ask: float  # it is asked by datagrams,
    pause: float  # so often,
    contact: float  # and once over TCP
    offline: float  # it is offline

    @classmethod
    def from_rate(cls, rate: float, settings: Settings) -> "Patience":
        """Patience with a master that promises so many beats a second."""
        if rate * settings.offline_after < 2:
            ask = settings.active_request_after
            return cls(ask, SLOW_PAUSE, ask + SLOW_PATIENCE / 2, ask + SLOW_PATIENCE)
        limit = settings.offline_after - MARGIN
        return cls(min(1.5 / rate, limit / 2), ASK_PAUSE, max(limit / 2, 1.25 / rate), limit)


class News(NamedTuple):
    """The answer of a peer that was asked over TCP, or that there was no answer."""

    now: float
    contact: Optional[Contact]
    problem: str  # why there is no contact
    starting: bool  # it answered, but it has no state yet
    gone: bool  # it was answered that there is no master
    asked: float


class Peers:
    """The table of the peers."""

    def __init__(self, settings: Settings, members: Members, local: LocalMaster, outbox: ActionOutbox) -> None:
        self.table: Dict[Key, Peer] = {}
        self.stale = False  # something may differ from the public list
        self._settings, self._members, self.local, self._outbox = settings, members, local, outbox
        self._first_step: Optional[float] = None  # see next_step
        self._crowds: Optional[Set[str]] = None  # addresses with several masters

    def mark_stale(self) -> None:
        """Note that something changed about a master, and not only the time of its last beat.

        With many masters most datagrams are plain beats. A look at all masters must not be made for each of them.
        """
        self.stale, self._first_step, self._crowds = True, None, None

    def addresses(self) -> Iterator[str]:
        """The addresses of all peers, some of them several times."""
        return (entry.key[0] for entry in self.table.values())

    # The table

    def has_room(self, entry: Peer) -> bool:
        """True if a newcomer can be listed. If one address has too many peers, one of these goes instead."""
        return len(self.table) < MAX_MASTERS or len(self._find_by_address(entry)) >= MAX_PER_ADDRESS

    def add(self, entry: Peer) -> None:
        """List a newcomer. If one address has too many peers, the one goes that sent nothing for the longest time."""
        same = self._find_by_address(entry)
        if len(same) >= MAX_PER_ADDRESS:
            del self.table[min(same, key=lambda other: other.beats[-1] if other.beats else other.since).key]
        self.table[entry.key] = entry

    def drop(self, entry: Peer, _now: float) -> None:
        """Forget a peer."""
        self.table.pop(entry.key, None)

    def _find_by_address(self, entry: Peer) -> List[Peer]:
        return [other for other in self.table.values() if other.key[0] == entry.key[0]]

    def identify(self, entry: Peer, contact: Contact, news: News) -> None:
        """Take the answer of a peer who it is."""
        entry.contact = contact
        stamp = Stamp.from_seconds(contact.stamp)
        # Only a beat says whether its own nodes changed. One that comes often is waited for, unless it is missed.
        regular = entry.rate * self._settings.offline_after >= 2
        awaited = news.asked - (1.0 / entry.rate if regular else 0.0)
        if stamp != entry.beat.stamp and not (entry.beats and entry.beats[-1] >= awaited):
            entry.beat = entry.beat._replace(stamp=stamp, local_stamp=stamp)
        entry.rate = entry.highest_rate(news.now - self._memory())

    # Heartbeats

    def hear(self, entry: Peer, beat: Heartbeat, now: float) -> None:
        """Take a heartbeat of a peer: it has not left. It is there again once its state has a stamp."""
        entry.heard, entry.checks = now, 0
        if beat.kind is Kind.REQUEST:
            if now - entry.contacted > CONTACT_PAUSE:  # the sender has perhaps just started, as a different master
                entry.contact_due = min(now, entry.contact_due)
        else:
            entry.beats.append(now)
            entry.beat = beat
            self._promise(entry, beat.rate, now)
            if not entry.online:
                due = now + (RETURNED if self._members.is_discovery(entry.key[0], entry.key[2]) else 0.0)
                entry.contact_due = min(due, entry.contact_due)
        entry.online = entry.online or entry.beat.stamp != Stamp()

    def _promise(self, entry: Peer, rate: float, now: float) -> None:
        """Take the rate in a heartbeat. A heartbeat can be forged. A lower rate delays that a loss is seen: it must be confirmed."""
        entry.promises[rate] = now
        promised = entry.highest_rate(now - self._memory())
        if promised > entry.rate:
            entry.rate = promised
        elif promised < entry.rate and now - entry.contacted > CONTACT_PAUSE and entry.contact_due == FAR:
            entry.contact_due = now

    def _memory(self) -> float:
        """Seconds for which a higher rate counts after it was heard."""
        limit = self._settings.offline_after
        return limit if limit > 0 else self._settings.active_request_after

    # Silence

    def wake(self, late: float, now: float) -> None:
        """Note that this computer was asleep for so long. The masters were not silent meanwhile."""
        self.mark_stale()
        for entry in self.table.values():
            entry.heard = min(now, entry.heard + late)

    def step(self, now: float) -> None:
        """Do all that is due about the masters."""
        if now < self.next_step():
            return
        self._first_step = None
        for entry in list(self.table.values()):
            for due, step in list(self._steps(entry)):
                if due <= now:
                    self.mark_stale()
                    step(entry, now)

    def next_step(self) -> float:
        """A time before which nothing is due about any master. A plain beat only delays due actions."""
        if self._first_step is None:
            steps = (at for entry in self.table.values() for at, _step in self._steps(entry))
            self._first_step = min(steps, default=FAR)
        return self._first_step

    def ask_soon(self, entry: Peer, at: float) -> None:
        """Have a peer asked over TCP at this time."""
        entry.contact_due, self._first_step = at, None

    def _steps(self, entry: Peer) -> Iterator[Step]:
        """The steps about a master that stays silent, each with its time."""
        heard, patience = entry.heard, Patience.from_rate(entry.rate, self._settings)
        if self.local.online:
            pause = patience.pause if entry.online else max(self._settings.active_request_after, patience.ask)
            pause = max(pause, SLOW_PAUSE) if self._is_crowded(entry) else pause
            yield max(heard + patience.ask, entry.requested + pause), self._request_state
        if entry.online and entry.probed < heard:
            yield heard + patience.contact, self._probe
        if entry.online:
            yield heard + patience.offline, self._lose
        if entry.asked is None:
            yield entry.contact_due, self._outbox.ask
        if self._settings.remove_after > 0:
            yield heard + self._settings.remove_after, self.drop

    def _lose(self, entry: Peer, _now: float) -> None:
        entry.online = False

    def _request_state(self, entry: Peer, now: float) -> None:
        entry.requested = now
        to_group = self._is_crowded(entry) and self._settings.send_mcast
        self._outbox.send(self.local.record(Kind.REQUEST), None if to_group else entry.key[0])

    def _is_crowded(self, entry: Peer) -> bool:
        """True if several masters share its address, so that unicast reaches only one of them."""
        if self._crowds is None:
            ports: Dict[str, Set[int]] = {}
            for address, _port, rpc_port in self.table:
                ports.setdefault(address, set()).add(rpc_port)
            self._crowds = {address for address, rpc_ports in ports.items() if len(rpc_ports) > 1}
        return entry.key[0] in self._crowds

    def _probe(self, entry: Peer, now: float) -> None:
        entry.probed = now
        patience = Patience.from_rate(entry.rate, self._settings)
        self._outbox.ask(entry, now, entry.heard + patience.offline - now)
