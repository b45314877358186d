# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Discovery of one master: datagrams and times in, datagrams and events out.

Theory of operation
-------------------
Each robot announces its own master by heartbeats: to a multicast group, to the hosts that are named, or to both. A
heartbeat says when the state of the master changed last (its stamp), and on which port its XML-RPC server answers. It
does not say who the master is.

So a new sender is a stranger first. It is asked over TCP who it is. Anybody can write any sender into a datagram, so
the number of strangers is bounded, only a few are asked at a time, and silent ones are forgotten.
Who answers becomes a peer that others are told of: `Event("new")`. Where the fleet is known (members.py), this is only
for its robots at their planned addresses, and for who is allowed besides; the rest are outsiders (outsiders.py).

A peer that is silent for longer than it promised is asked by datagrams, then over TCP, and then it is offline. It stays
listed, so that it is online again with its first heartbeat, and is removed after ~remove_after. A LEAVE says that a
peer goes. Anybody can write that too: the peer is asked several times over TCP, and stays if it answers. The table
`LIFE` in peer.py has all states, signs and transitions; the methods that carry out its acts are in `Discovery._acts`.

The own master is announced several times after each change, since one lost datagram must not delay it. While the own
roscore does not answer, nothing is announced, and after a while the others are told that it leaves.

There are no sockets, threads and clocks here: every time is an argument, in seconds of a clock that never steps. What is
to be done accumulates in `Discovery.actions`. The program takes it from there, in one place, and carries it out.
"""

from collections import deque
from itertools import takewhile
from typing import (
    Callable,
    Container,
    Deque,
    Dict,
    Iterable,
    Iterator,
    List,
    NamedTuple,
    Optional,
    Sequence,
    Set,
    Tuple,
    Union,
)

from ...protocol.heartbeat import Heartbeat, Kind, Malformed, Stamp, decode, encode
from ...protocol.members import Members
from ...protocol.messages import Link, Master
from ...protocol.parameters import Settings
from ...protocol.plain_text import quoted
from .outsiders import Budget, Outsiders
from .peer import LONG_AGO, Act, Contact, Key, Peer, Sign

REPEAT_CHANGES = (0.0, 0.2, 1.0)  # seconds after a change: one lost datagram must not delay it
OFTEN = 1.0  # heartbeats a second, of which the next one is soon enough to tell that what a master has of others has changed
REPEAT_REQUESTS = (0.0, 1.0, 5.0)  # seconds after the start
ECHO = 0.05  # seconds between a heartbeat to the group and the same one by unicast, or the other way round, at most
ANSWER_PAUSE = 0.1  # seconds between two answers to one address
SCAN, EARLY = 1.0, 0.5  # seconds between two ticks at most; and the tidying may come so much before its time
ASLEEP = 1.5  # seconds between two ticks after which this computer was asleep, and the others were not silent
MARGIN = 0.5  # of ~offline_after: the time that master_sync has to withdraw what a lost master had
ASK_PAUSE = 0.2  # seconds between two requests to a master that missed its beat
SLOW_PAUSE, SLOW_PATIENCE = 1.0, 5.5  # seconds: the same for a master that promises few beats, and how long it is asked
CONTACT_LIMIT, STRANGER_LIMIT, LEAVE_LIMIT = 3.0, 1.5, 1.0  # seconds for an answer over TCP
CONTACT_RETRY = 5.0  # seconds
CONTACT_RETRY_NO_STATE = 1.0  # seconds: it answered that it has no state yet
RETURNED = 5.0  # seconds after the return of a robot of the fleet: its place says who it is, and what it offers is wanted first
CONTACT_PAUSE = 5.0  # seconds between two contacts that nothing but requests of the other side ask for
LEAVE_CHECKS = (0.2, 1.0, 3.0)  # seconds: who still answers after these has not left
LEAVE_PAUSE = 1.0  # seconds between a contact and the first check of another LEAVE
DEAD_AFTER, LEAVE_AFTER = 1.0, 5.0  # seconds without the own roscore: it is offline; the others are told to forget it
MAX_MASTERS, MAX_PER_ADDRESS = 1024, 16  # more would be somebody's flood
MAX_STRANGERS, MAX_ASKED = 1024, 32  # senders that have not said who they are; those that are asked at the same time
MAX_ANSWERED = 4096  # addresses that are answered in a second
FORGET_STRANGER = 30.0  # seconds of silence
FAR = float("inf")
Sent = Tuple[Tuple[str, int], bytes]  # a datagram: from, content


class Patience(NamedTuple):
    """The consequences of silence, in seconds since the last sign of life of a master."""

    ask: float  # it is asked by datagrams,
    pause: float  # so often,
    contact: float  # and once over TCP
    offline: float  # it is offline

    @classmethod
    def with_rate(cls, rate: float, settings: Settings) -> "Patience":
        """Patience with a master that promises so many beats a second."""
        if rate * settings.offline_after < 2:
            ask = settings.active_request_after
            return cls(ask, SLOW_PAUSE, ask + SLOW_PATIENCE / 2, ask + SLOW_PATIENCE)
        limit = settings.offline_after - MARGIN
        return cls(min(1.5 / rate, limit / 2), ASK_PAUSE, max(limit / 2, 1.25 / rate), limit)


def misnamed(contact: Contact, heard: str, address: str, there: Optional[Contact]) -> str:
    """The reason why the nodes of a master cannot be reached by its name; empty where they can.

    `heard` is the address that it sends from, `address` that of its name ("" for none), `there` who answers at the latter.
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


class Send(NamedTuple):
    """Send a datagram to the group (host None) or to a host, always to the port of the protocol."""

    datagram: bytes
    host: Optional[str]


class Ask(NamedTuple):
    """Call masterContacts at a monitor URI and hand the result to `contacted`."""

    key: Key
    monitor_uri: str
    limit: float  # seconds for the whole answer
    stranger: bool  # it has not said yet who it is: must not keep the others waiting


class Event(NamedTuple):
    """A master is new, changed or removed."""

    change: str
    master: Master


class Say(NamedTuple):
    """A line for the log. Lines of one topic are limited in rate."""

    level: str  # info, warning, error
    topic: str
    text: str


Action = Union[Send, Ask, Event, Say]


Step = Tuple[float, Callable[[Peer, float], None]]  # when, and what


class News(NamedTuple):
    """The answer of a peer that was asked over TCP, or of none, for the acts that need it."""

    now: float
    contact: Optional[Contact] = None
    problem: str = ""  # why there is no contact
    starting: bool = False  # it answered, but it has no state yet
    asked: float = LONG_AGO


class Discovery:
    """The discovery of one master."""

    def __init__(
        self, settings: Settings, own_addresses: Iterable[str], rpc_port: int, members: Optional[Members] = None
    ) -> None:
        self.settings = settings
        self.members = Members() if members is None else members
        self.outsiders = Outsiders()
        self.own_addresses = frozenset(own_addresses)
        self.networks: Optional[Container[str]] = None  # of this computer; None where they do not matter
        self.rpc_port = rpc_port
        self.actions: Deque[Action] = deque()
        self.malformed = 0
        self.refused = 0
        self._own: Optional[Master] = None
        self._own_beats: Deque[float] = deque(maxlen=512)
        self._own_since = 0.0
        self._left = False
        self._entries: Dict[Key, Peer] = {}
        self._strangers: Dict[Key, Peer] = {}  # in the order in which they were last heard
        self._asked: Set[Key] = set()  # strangers that are being asked who they are
        self._budget = Budget()
        self._turn = False
        self._public: Dict[str, Master] = {}
        self._echoes: Dict[Sent, Tuple[Peer, float]] = {}  # the last heartbeats
        self._stale = False  # something may be another than what is public
        self._first_step: Optional[float] = None  # see _next_step
        self._crowds: Optional[Set[str]] = None  # addresses with several masters
        self._announce: List[float] = []
        self._request: List[float] = []
        self._ticked: Optional[float] = None
        self._next_beat = 0.0
        self._next_scan = 0.0
        self._answered: Dict[Optional[str], float] = {}
        self._acts: Dict[Act, Callable[[Peer, News], None]] = {
            Act.NOTHING: lambda _peer, _news: None,
            Act.ADMIT: self._admit,
            Act.IDENTIFY: self._identify,
            Act.ASK_LATER: self._ask_later,
            Act.WAIT_FOR_ROOM: self._wait_for_room,
            Act.CHECK: self._check,
            Act.CHECK_AGAIN: self._check_again,
            Act.KEEP: self._keep,
            Act.REFUSE: self._refuse,
            Act.EXPEL: self._refuse,
            Act.DROP: self._drop,
        }

    # What the program tells

    def own_state(self, master: Master, now: float) -> None:
        """Take the state of the own master: its roscore answers. A changed state is announced, several times."""
        self._news()
        before, self._own, self._left = self._own, master, False
        if before is None:
            self._own_since = now
        if before is None or not before.online:
            self.greet(now)
        elif before.local_stamp != master.local_stamp or (
            before.stamp != master.stamp and self.settings.heartbeat_hz < OFTEN
        ):
            self._announce = [now + after for after in REPEAT_CHANGES]
        self._publish()
        self.tick(now)

    def own_failed(self, since: float, now: float) -> bool:
        """Note that the roscore has not answered since then. True where it counts as offline by now."""
        if now - since <= DEAD_AFTER:
            return False
        if self._own is not None and self._own.online:
            self._news()
            self._own = Master(**{**self._own.__dict__, "online": False})
            self._announce = []
            self._publish()
        if self._own is not None and now - since >= LEAVE_AFTER and not self._left:
            self._left = True
            self._announce = [now + after for after in REPEAT_CHANGES]
        self.tick(now)
        return True

    def in_networks(self, networks: Container[str]) -> None:
        """Take the networks of this computer. Where the fleet is known, who is in none of them is not asked who it is."""
        self.networks = networks if self.members.robots else None

    def own_moved(self, own_addresses: Iterable[str]) -> None:
        """Take the new addresses of this computer: no peer at one of them is another master."""
        self._news()
        self.own_addresses = frozenset(own_addresses)
        for table in (self._entries, self._strangers):
            for key in [key for key in table if self._is_own(key[0]) and key[2] == self.rpc_port]:
                del table[key]
        self._publish()

    def greet(self, now: float) -> None:
        """Tell the others and ask them, since this master or its network has just come."""
        self._announce = [now + after for after in REPEAT_CHANGES]
        self._request = [now + after for after in REPEAT_REQUESTS]

    def leave(self) -> None:
        """Tell the others that this node ends."""
        self._to_all(self._record(Kind.LEAVE))

    def refresh(self, now: float) -> None:
        """Ask everybody for their state now."""
        for host in {entry.key[0] for entry in self._entries.values()}:
            self._send(self._record(Kind.REQUEST), host)
        self._request = [now]
        self.tick(now)

    def datagram(self, data: bytes, source: Tuple[str, int], multicast: bool, now: float) -> None:
        """Take a datagram. An empty one is a probe of somebody's verification."""
        if self._says_nothing(data, source, now):
            return
        try:
            beat = decode(data)
        except Malformed as problem:
            self.malformed += 1
            self._say("warning", "malformed", f"a datagram from {source[0]}:{source[1]} is ignored: {problem}")
            return
        if beat.rpc_port == self.rpc_port and self._is_own(source[0]):
            if beat.kind is Kind.STATE:
                self._own_beats.append(now)
            return
        planned = self.members.is_discovery(source[0], beat.rpc_port)
        if not planned and not self._is_admitted(source[0]):
            if beat.kind is not Kind.LEAVE:
                self.outsiders.heard(source[0], beat.rpc_port, now, self.may_ask(source[0]))
                self._meet(now)
            return
        key = (source[0], 0 if planned else source[1], beat.rpc_port)
        entry = self._entries.get(key)
        if beat.kind is Kind.LEAVE:
            if entry is not None:
                self._news()
                self._move(entry, Sign.LEAVE, News(now))
            return
        if beat.kind is Kind.REQUEST:
            self._answer(source[0], multicast, now)
        if entry is None:
            self._stranger(key, beat, now)
        else:
            self._heard(entry, beat, now)
            self._remember(entry, beat, (source, data), now)

    def _remember(self, entry: Peer, beat: Heartbeat, sent: Sent, now: float) -> None:
        if beat.kind is Kind.STATE and len(self._echoes) < MAX_MASTERS:
            self._echoes[sent] = (entry, now)

    def _says_nothing(self, data: bytes, source: Tuple[str, int], now: float) -> bool:
        """True for an empty datagram, and for a heartbeat that came a moment ago by the other way: to the group or by unicast."""
        if not data:
            return True
        entry, at = self._echoes.get((source, data), (None, LONG_AGO))
        if entry is None or now - at > ECHO or not entry.online or entry.leaving or entry.overdue or entry.given_up:
            return False
        entry.beats.append(now)
        return True

    def contacted(
        self,
        key: Key,
        contact: Optional[Contact],
        problem: str,
        now: float,
        *,
        gone: bool = False,
        fault: bool = False,
    ) -> bool:
        """Take the result of an Ask: the answer, or None and why. True where it is a master that is listed.

        `gone`: it was answered that there is no master, `fault`: by a discovery node.
        """
        self._news()
        self._asked.discard(key)
        entry = self._entries.get(key) or self._strangers.get(key)
        if entry is None:
            why = (
                self._objection(key, contact) or f"its discovery answers at port {key[2]}, which is not the planned one"
            )
            self.outsiders.answered(key, contact, why, now)
            self._meet(now)
            return False
        asked, entry.asked, entry.contacted, entry.contact_due = entry.asked, None, now, None
        if contact is not None or fault:  # a port that is closed is nobody's answer
            self._budget.answered(key[0])
        if contact is None and not fault:
            entry.failed = now
        starting = contact is not None and contact.stamp <= 0.0
        if starting:
            contact, problem = None, "it has no state yet"
        if contact is not None:
            entry.heard = now
        news = News(now, contact, problem, starting, LONG_AGO if asked is None else asked)
        self._move(entry, self._sign_of(entry, contact, gone), news)
        self._publish()
        self._meet(now)
        return contact is not None and key in self._entries

    def _sign_of(self, entry: Peer, contact: Optional[Contact], gone: bool) -> Sign:
        last = entry.checks == len(LEAVE_CHECKS)
        if contact is None:
            return Sign.REFUSAL if gone else Sign.LAST_NO_ANSWER if last else Sign.NO_ANSWER
        if self._objection(entry.key, contact):
            return Sign.FOREIGN
        if entry.contact is None and not self._has_room(entry):
            return Sign.NO_ROOM
        return Sign.LAST_ANSWER if last else Sign.ANSWER

    def _move(self, entry: Peer, sign: Sign, news: News) -> None:
        """Change the state of a peer, and do what its table says."""
        self._acts[entry.move(sign)](entry, news)

    def tick(self, now: float) -> None:
        """Do what is due; at least once a second."""
        late = now - self._ticked if self._ticked is not None else 0.0
        self._ticked = now
        if late > ASLEEP:
            self._awake(late, now)
        self._speak(now)
        if now >= self._next_step():
            self._step(now)
        if now >= self._next_scan - EARLY:  # rather now than to wake for it
            self._next_scan = now + SCAN
            self._answered = {host: at for host, at in self._answered.items() if now - at < ANSWER_PAUSE}
            self._echoes.clear()
            self.outsiders.forget(now)
            while self._strangers and now - next(iter(self._strangers.values())).heard > FORGET_STRANGER:
                self._strangers.pop(next(iter(self._strangers)))
        if self._stale:
            self._publish()
        self._meet(now)

    def _news(self) -> None:
        """Note that something is another about some master, and not only the time of its last beat.

        With many masters most datagrams are plain beats. What looks at all masters must not be done for each of them.
        """
        self._stale, self._first_step, self._crowds = True, None, None

    def _awake(self, late: float, now: float) -> None:
        """This computer was asleep, and nobody was silent meanwhile."""
        self._news()
        for entry in self._entries.values():
            entry.heard = min(now, entry.heard + late - SCAN)

    def _step(self, now: float) -> None:
        """Do what is due about the masters."""
        self._first_step = None
        for entry in list(self._entries.values()):
            for due, step in list(self._steps(entry)):
                if due <= now:
                    self._news()
                    step(entry, now)

    def _next_step(self) -> float:
        """A time before which nothing is due about any master. A plain beat only puts off what is."""
        if self._first_step is None:
            steps = (at for entry in self._entries.values() for at, _step in self._steps(entry))
            self._first_step = min(steps, default=FAR)
        return self._first_step

    def next_tick(self) -> float:
        """The time at which `tick` has something to do."""
        due = [self._next_step()]
        if len(self._asked) < MAX_ASKED:
            due += [at for at, _entry in self._unmet()]
        outsider = self.outsiders.next_due()
        if outsider is not None:
            due.append(outsider)
        if self._own is not None:
            due += self._announce
        if self._online():
            due += [*self._request, self._next_beat]
        return min([self._next_scan, *due])

    # What the program asks

    def masters(self) -> List[Master]:
        """All masters, the own one first."""
        return sorted(
            self._public.values(), key=lambda master: (master.uri != self._own_uri(), master.name, master.uri)
        )

    def links(self, now: float) -> List[Link]:
        """The quality of the links to all masters, as `~linkstats` shows it."""
        found = []
        if self._own is not None:
            heard = self._own_beats[-1] if self._own_beats else now
            quality = self._quality(self._own_beats, self.settings.heartbeat_hz, self._own_since, now)
            found.append(Link(self._own.name, quality, now - heard, self._own.uri))
        for entry in self._entries.values():
            if entry.contact is not None:
                quality = self._quality(entry.beats, entry.rate, entry.since, now)
                found.append(Link(entry.contact.name, quality, now - entry.heard, entry.contact.uri))
        return found

    # Who may be a master here, and who is asked

    def may_ask(self, address: str) -> bool:
        """True where a connection to an address may be made that somebody else names: never to this computer itself."""
        if address.startswith("127.") or address == "0.0.0.0":
            return False
        if self.networks is None:
            return True
        own = self.members.master(self._own_uri() or "")
        if address in self.own_addresses or (own is not None and address in own.addresses):
            return False  # also a planned address that no interface has yet
        if self.members.at(address) is not None or address in self.members.allow:
            return True
        return address in self.networks or address in self.settings.robot_hosts

    def _is_admitted(self, address: str) -> bool:
        """True where the sender may be an allowed stranger."""
        return self.members.admits(address) and self.may_ask(address)

    def _objection(self, key: Key, contact: Optional[Contact]) -> str:
        return "" if contact is None else self.members.objection(contact.uri, contact.name, key[0])

    def _refuse(self, entry: Peer, news: News) -> None:
        """Do not exchange with who is not what it says. Its heartbeats go on being heard."""
        if news.contact is not None:
            self.outsiders.refused(entry.key, news.contact, self._objection(entry.key, news.contact), news.now)
        self._entries.pop(entry.key, None)
        entry.contact_due = news.now + FORGET_STRANGER

    def _tell_news(self) -> None:
        """Say who is ignored, each once."""
        for outsider in self.outsiders.news:
            self._say("warning", f"outsider {outsider.address}", str(outsider))
        self.outsiders.news.clear()

    # Strangers: senders that have not said who they are. Anybody can write any sender into a datagram, so there may be many.

    def _stranger(self, key: Key, beat: Heartbeat, now: float) -> None:
        entry = self._strangers.pop(key, None)
        if entry is None:
            entry = Peer(key, now, now, beat, contact_due=now)
            if len(self._strangers) >= MAX_STRANGERS:
                self.refused += 1
                self._say(
                    "warning", "full", f"{MAX_STRANGERS} senders do not say who they are: the first are forgotten"
                )
                del self._strangers[next(first for first in self._strangers if first not in self._asked)]
        self._strangers[key] = entry
        entry.heard, entry.credit = now, entry.credit + 1
        if entry.contact_due is None and entry.asked is None and self._free(entry, now) <= now:
            entry.contact_due = now
        if beat.kind is Kind.STATE:
            entry.beat = beat
            entry.promises[beat.rate] = now
            entry.beats.append(now)
        self._meet(now)

    def _meet(self, now: float) -> None:
        """Ask strangers who they are, not too many at a time.

        A flood may have ever other senders: so first comes who is heard most. It may have the same ones again and again:
        so every second time, first comes who was not asked yet.
        """
        self._tell_news()
        for key in self.outsiders.due(now):
            self.actions.append(Ask(key, f"http://{key[0]}:{key[2]}", STRANGER_LIMIT, True))
        while len(self._asked) < MAX_ASKED:
            waiting = [entry for due, entry in self._unmet() if due <= now]
            if not waiting:
                return
            self._turn = not self._turn
            entry = max(waiting, key=lambda entry: (-entry.failures if self._turn else 0, entry.credit))
            if self._free(entry, now) > now:
                entry.contact_due = None  # until it is heard after that time
                continue
            self._budget.spend(entry.key[0], now)
            self._asked.add(entry.key)
            self._ask(entry, now, STRANGER_LIMIT)

    def _free(self, entry: Peer, now: float) -> float:
        """The time from which a stranger may be asked: twice, and later again, unless a member is planned there."""
        if self.members.is_discovery(entry.key[0], entry.key[2]):
            return now
        return self._budget.free(entry.key[0], now)

    def _unmet(self) -> Iterator[Tuple[float, Peer]]:
        for entry in self._strangers.values():
            if entry.contact_due is not None and entry.asked is None:
                yield entry.contact_due, entry

    def _ask_later(self, entry: Peer, news: News) -> None:
        entry.contact_due = news.now + (CONTACT_RETRY_NO_STATE if news.starting else CONTACT_RETRY)
        entry.credit, entry.failures = 0, entry.failures + 1
        if entry.contact is None:
            self._say(
                "warning",
                f"contact {entry.key[0]}" if len(self._strangers) <= MAX_PER_ADDRESS else "contacts",
                f"{entry.monitor_uri} is heard, but does not say who it is: {quoted(news.problem)}",
            )

    def _has_room(self, entry: Peer) -> bool:
        """True where a stranger can be listed. Of too many of one address, another goes instead."""
        return len(self._entries) < MAX_MASTERS or len(self._of_address(entry)) >= MAX_PER_ADDRESS

    def _of_address(self, entry: Peer) -> List[Peer]:
        return [other for other in self._entries.values() if other.key[0] == entry.key[0]]

    def _wait_for_room(self, entry: Peer, _news: News) -> None:
        self.refused += 1
        self._say("warning", "masters", f"{entry.monitor_uri} is ignored: {MAX_MASTERS} masters are known already")
        entry.contact_due = entry.contacted + FORGET_STRANGER

    def _admit(self, entry: Peer, news: News) -> None:
        """List a stranger. Where one address has too many peers, the one goes that sent nothing for the longest time."""
        same = self._of_address(entry)
        if len(same) >= MAX_PER_ADDRESS:
            del self._entries[min(same, key=lambda other: other.beats[-1] if other.beats else other.since).key]
        self._entries[entry.key] = self._strangers.pop(entry.key)
        self._identify(entry, news)

    def _identify(self, entry: Peer, news: News) -> None:
        known, contact = entry.contact, news.contact
        if contact is None:
            return
        entry.contact = contact
        stamp = Stamp.at(contact.stamp)
        # Only a beat says whether its own nodes changed. One that comes often is waited for, unless it is missed.
        regular = entry.rate * self.settings.offline_after >= 2
        awaited = news.asked - (1.0 / entry.rate if regular else 0.0)
        if stamp != entry.beat.stamp and not (entry.beats and entry.beats[-1] >= awaited):
            entry.beat = entry.beat._replace(stamp=stamp, local_stamp=stamp)
        entry.rate = entry.promised(news.now - self._memory())
        if known is None or known.uri != contact.uri:
            self._report_twins(entry, contact)

    def _report_twins(self, entry: Peer, contact: Contact) -> None:
        if contact.uri == self._own_uri():
            text = (
                f"{entry.monitor_uri} calls its master {contact.uri}, as this computer calls its own: nothing is"
                " exchanged with it; set ROS_HOSTNAME or ROS_IP before roscore starts, on both"
            )
            self._say("error", f"same {entry.key[0]}", text)
        for peer in self._entries.values() if self.members.master(contact.uri) is None else ():
            if peer.contact is not None and peer.contact.uri == contact.uri and peer.key[0] != entry.key[0]:
                text = (
                    f"{contact.name} ({contact.uri}) answers at {peer.key[0]} and at {entry.key[0]}: it stays where it is for"
                    " as long as it answers there"
                )
                self._say("warning", f"twice {contact.uri}", text)
        for other in self._public.values():
            if other.name == contact.name and other.uri != contact.uri:
                text = f"two masters are called {contact.name}: {other.uri} and {contact.uri}; give one another name"
                self._say("warning", f"name {contact.name}", text)

    # Masters: senders that have said who they are

    def _heard(self, entry: Peer, beat: Heartbeat, now: float) -> None:
        before = entry.outlook()
        entry.heard = now
        if beat.kind is Kind.REQUEST:
            if now - entry.contacted > CONTACT_PAUSE:  # who asks has perhaps just started, as somebody else
                entry.contact_due = now if entry.contact_due is None else min(now, entry.contact_due)
        else:
            entry.beats.append(now)
            entry.beat = beat
            self._promised(entry, beat.rate, now)
            if not entry.online:
                due = now + (RETURNED if self.members.is_discovery(entry.key[0], entry.key[2]) else 0.0)
                entry.contact_due = due if entry.contact_due is None else min(due, entry.contact_due)
        self._move(entry, Sign.HEARD if entry.beat.stamp != Stamp() else Sign.HEARD_EMPTY, News(now))
        if entry.outlook() != before:
            self._news()  # told with the next tick: where many masters meet, many datagrams are read at once

    def _promised(self, entry: Peer, rate: float, now: float) -> None:
        """Take the rate in a heartbeat, which anybody can write. A lower one delays that a loss is seen: it must be confirmed."""
        entry.promises[rate] = now
        promised = entry.promised(now - self._memory())
        if promised > entry.rate:
            entry.rate = promised
        elif promised < entry.rate and now - entry.contacted > CONTACT_PAUSE and entry.contact_due is None:
            entry.contact_due = now

    def _memory(self) -> float:
        """Seconds for which a higher rate counts after it was heard."""
        return self.settings.offline_after if self.settings.offline_after > 0 else self.settings.active_request_after

    def _steps(self, entry: Peer) -> Iterator[Step]:
        """The steps about a master that stays silent, each with its time."""
        heard, patience = entry.heard, Patience.with_rate(entry.rate, self.settings)
        if self._online():
            pause = patience.pause if entry.online else max(self.settings.active_request_after, patience.ask)
            pause = max(pause, SLOW_PAUSE) if self._crowded(entry) else pause
            yield max(heard + patience.ask, entry.requested + pause), self._request_state
        if entry.online and entry.probed < heard:
            yield heard + patience.contact, self._probe
        if entry.online:
            yield heard + patience.offline, self._silent
        if entry.contact_due is not None and entry.asked is None:
            yield entry.contact_due, self._ask
        if self.settings.remove_after > 0:
            yield heard + self.settings.remove_after, self._long_silent

    def _request_state(self, entry: Peer, now: float) -> None:
        entry.requested = now
        to_group = self._crowded(entry) and self.settings.send_mcast
        self._send(self._record(Kind.REQUEST), None if to_group else entry.key[0])

    def _crowded(self, entry: Peer) -> bool:
        """True where several masters share its address, so that unicast reaches only one of them."""
        if self._crowds is None:
            ports: Dict[str, Set[int]] = {}
            for address, _port, rpc_port in self._entries:
                ports.setdefault(address, set()).add(rpc_port)
            self._crowds = {address for address, found in ports.items() if len(found) > 1}
        return entry.key[0] in self._crowds

    def _probe(self, entry: Peer, now: float) -> None:
        entry.probed = now
        patience = Patience.with_rate(entry.rate, self.settings)
        self._ask(entry, now, entry.heard + patience.offline - now)

    def _ask(self, entry: Peer, now: float, limit: float = CONTACT_LIMIT) -> None:
        if entry.asked is None:
            entry.asked = now
            limit = LEAVE_LIMIT if entry.leaving else limit
            self.actions.append(Ask(entry.key, entry.monitor_uri, limit, entry.contact is None))

    def _silent(self, entry: Peer, now: float) -> None:
        self._move(entry, Sign.SILENCE, News(now))

    def _long_silent(self, entry: Peer, now: float) -> None:
        self._move(entry, Sign.LONG_SILENCE, News(now))

    def _drop(self, entry: Peer, _news: News) -> None:
        self._entries.pop(entry.key, None)

    # After a LEAVE: who still answers has not left, whatever a datagram says

    def _check(self, entry: Peer, news: News) -> None:
        entry.checks = 1
        entry.contact_due = max(news.now + LEAVE_CHECKS[0], entry.contacted + LEAVE_PAUSE)

    def _check_again(self, entry: Peer, news: News) -> None:
        entry.contact_due = news.now + LEAVE_CHECKS[entry.checks if news.contact else 0]
        entry.checks += 1
        self._send(self._record(Kind.REQUEST), entry.key[0])

    def _keep(self, entry: Peer, _news: News) -> None:
        name = entry.contact.name if entry.contact is not None else entry.monitor_uri
        self._say(
            "warning",
            f"leave {entry.key[0]}",
            f"{name} was said to leave, but answers at {entry.monitor_uri}: kept",
        )

    # What others see

    def _publish(self) -> None:
        """Compare what is known with what was told, and tell the difference.

        Masters are known by their URI here: one that is heard from two addresses is there while one of them is. Anybody
        can answer with the URI of another one. So it is shown at the same address until it does not answer there over TCP.
        """
        self._stale = False
        found: Dict[str, List[Peer]] = {}
        for entry in self._entries.values():
            if entry.contact is not None:
                found.setdefault(entry.contact.uri, []).append(entry)
        public = {uri: self._shown(uri, entries) for uri, entries in found.items()}
        if self._own is not None:
            public[self._own.uri] = self._own
        if public == self._public:
            return
        before, self._public = self._public, public
        for uri, master in before.items():
            if uri not in public:
                self.actions.append(Event("removed", Master(**{**master.__dict__, "online": False})))
        for uri, master in public.items():
            if uri not in before:
                self.actions.append(Event("new", master))
            elif master != before[uri]:
                self.actions.append(Event("changed", master))

    def _shown(self, uri: str, entries: Sequence[Peer]) -> Master:
        """The master with this URI, of the peers that say so."""
        before = self._public.get(uri)
        at = before.monitor_uri if before is not None else ""

        def rank(entry: Peer) -> Tuple[bool, bool, bool]:
            return entry.monitor_uri == at and not entry.given_up, entry.online, not entry.overdue

        best = max(entries, key=rank) if len(entries) > 1 else entries[0]
        if len(entries) > 1 and (best.overdue or not best.online) and best.contact_due is None and best.asked is None:
            best.contact_due, self._first_step = (
                self._ticked,
                None,
            )  # is it still there? Another one waits for its place
        return best.master()

    def _own_uri(self) -> Optional[str]:
        return self._own.uri if self._own else None

    def _online(self) -> bool:
        """True where there is an own state to tell of."""
        return self._own is not None and self._own.online

    def _is_own(self, address: str) -> bool:
        return address in self.own_addresses or address.startswith("127.")

    def _quality(self, beats: Deque[float], rate: float, since: float, now: float) -> float:
        if rate < 0.1:
            return -1.0
        window = min(self.settings.measurement_intervals / min(rate, 1.0), max(now - since, 1.0 / rate))
        received = sum(1 for _at in takewhile(lambda at: now - at <= window, reversed(beats)))  # the last ones
        return min(100.0, 100.0 * received / (rate * window))

    # Datagrams

    def _record(self, kind: Kind) -> bytes:
        if kind is not Kind.STATE or self._own is None:
            return encode(Heartbeat(kind, self.rpc_port))
        stamp, local = Stamp.at(self._own.stamp), Stamp.at(self._own.local_stamp)
        return encode(Heartbeat(kind, self.rpc_port, self.settings.heartbeat_hz, stamp, local))

    def _speak(self, now: float) -> None:
        """Tell the others what is due: the state, that it has gone, and a request for theirs."""
        self._announce_state(now)
        if self._online() and any(due <= now for due in self._request):
            self._request = [due for due in self._request if due > now]
            self._request_states()

    def _announce_state(self, now: float) -> None:
        announce = self._own is not None and any(due <= now for due in self._announce)
        self._announce = [due for due in self._announce if due > now]
        if self._online() and (announce or now >= self._next_beat):
            self._next_beat = now + 1.0 / max(self.settings.heartbeat_hz, 0.02)
            self._to_all(self._record(Kind.STATE))
        elif announce:
            self._to_all(self._record(Kind.LEAVE))

    def _request_states(self) -> None:
        if self.settings.listen_mcast and self.settings.send_mcast:
            self._send(self._record(Kind.REQUEST), None)
        for host in self.settings.robot_hosts:
            self._send(self._record(Kind.REQUEST), host)

    def _answer(self, host: str, multicast: bool, now: float) -> None:
        if not self._online() or len(self._answered) > MAX_ANSWERED:
            return
        group: Tuple[Optional[str], ...] = (None,) if multicast and self.settings.send_mcast else ()
        for target in group + (host,):
            if now - self._answered.get(target, LONG_AGO) >= ANSWER_PAUSE:
                self._answered[target] = now
                self._send(self._record(Kind.STATE), target)

    def _to_all(self, datagram: bytes) -> None:
        hosts = list(self.settings.robot_hosts)
        if self.settings.send_mcast:
            self._send(datagram, None)
        else:
            hosts += [entry.key[0] for entry in self._entries.values()]
        for host in dict.fromkeys(hosts):
            self._send(datagram, host)

    def _send(self, datagram: bytes, host: Optional[str]) -> None:
        if host is None or not self._is_own(host):
            self.actions.append(Send(datagram, host))

    def _say(self, level: str, topic: str, text: str) -> None:
        self.actions.append(Say(level, topic, text))
