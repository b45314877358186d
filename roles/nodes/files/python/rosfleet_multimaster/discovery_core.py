# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Who is there: datagrams and times in, datagrams and events out.

Free of sockets, threads and clocks: every time is an argument, in seconds of a clock that never steps.
What is to be done accumulates in `Discovery.actions`, which the program takes and carries out.
"""

from collections import deque
from dataclasses import dataclass, field
from typing import Any, Deque, Dict, Iterable, List, NamedTuple, Optional, Sequence, Tuple, Union
from urllib.parse import urlsplit

from .heartbeat import Heartbeat, Kind, Malformed, Stamp, decode, encode

Key = Tuple[str, int, int]  # address and UDP port of the sender, port of its XML-RPC server

REPEAT_CHANGES = (0.0, 0.2, 1.0)  # seconds after a change: one lost datagram must not delay it
REPEAT_REQUESTS = (0.0, 1.0, 5.0)  # seconds after the start
ANSWER_PAUSE = 0.2  # seconds between two answers to one address
SCAN = 1.0  # seconds between two looks at who is silent
ASLEEP = 3.0  # seconds between two ticks after which this computer was asleep, and the others were not silent
UNANSWERED = 5  # requests after which a silent master is offline
CONTACT_RETRY = 5.0  # seconds
CONTACT_RETRY_NO_STATE = 1.0  # seconds: it answered that it has no state yet
CONTACT_PAUSE = 5.0  # seconds between two contacts that nothing but requests of the other side ask for
LEAVE_CHECKS = (0.2, 1.0, 3.0)  # seconds: who still answers after these has not left
MAX_MASTERS = 1024  # more would be somebody's flood
MAX_NAME = 1024  # characters of a name or URI in an answer
FORGET_UNKNOWN = 30.0  # seconds of silence after which an entry that never said who it is goes


@dataclass(frozen=True)
class Settings:
    """The parameters that the core needs, with upstream's names and defaults (times in seconds)."""

    heartbeat_hz: float = 0.02
    active_request_after: float = 60.0
    remove_after: float = 300.0
    measurement_intervals: int = 5
    timeout_factor: float = 10.0
    robot_hosts: Sequence[str] = ()
    send_mcast: bool = True
    listen_mcast: bool = True


class Contact(NamedTuple):
    """What masterContacts of another discovery node answered."""

    stamp: float
    uri: str
    name: str
    discoverer: str

    @classmethod
    def of(cls, answer: Any) -> "Contact":
        """The contact in an answer, which may be anybody's. Raises ValueError."""
        if not isinstance(answer, list) or len(answer) < 4 or not all(isinstance(part, str) for part in answer[:4]):
            raise ValueError("it does not say who it is")
        stamp, (uri, name, discoverer) = float(answer[0]), answer[1:4]
        if not 0.0 <= stamp < 2**31:
            raise ValueError(f"its stamp is {answer[0][:40]}")
        if max(len(uri), len(name), len(discoverer)) > MAX_NAME:
            raise ValueError(f"a name of more than {MAX_NAME} characters")
        if not uri.startswith("http://") or not urlsplit(uri).hostname:
            raise ValueError(f"it calls its master {uri}")
        return cls(stamp, uri, name, discoverer)

    @property
    def host(self) -> str:
        """The host that the master calls its own."""
        return urlsplit(self.uri).hostname or ""


def misnamed(contact: Contact, heard: str, address: str, there: Optional[Contact]) -> str:
    """Why the nodes of a master cannot be reached by its name, or an empty text.

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


@dataclass(frozen=True)
class Master:
    """A master as `~list_masters` and `~changes` show it."""

    name: str
    uri: str
    stamp: float
    local_stamp: float
    online: bool
    discoverer: str
    monitor_uri: str


class Link(NamedTuple):
    """The quality of the link to a master: per cent of the expected heartbeats, -1 where none are promised."""

    name: str
    quality: float
    silent: float  # seconds since the last datagram


class Send(NamedTuple):
    """Send a datagram to the group (host None) or to a host, always to the port of the protocol."""

    datagram: bytes
    host: Optional[str]


class Ask(NamedTuple):
    """Call masterContacts at a monitor URI and hand the result to `contacted`."""

    key: Key
    monitor_uri: str


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


@dataclass
class _Entry:
    """One sender. A robot that is heard from two addresses has two."""

    key: Key
    since: float
    heard: float
    beat: Heartbeat
    contact: Optional[Contact] = None
    online: bool = False
    unanswered: int = 0
    asked: float = 0.0
    contact_due: Optional[float] = None
    contacting: bool = False
    contacted: float = 0.0
    leaving: int = 0  # how many checks after a LEAVE were answered, plus one
    beats: Deque[float] = field(default_factory=lambda: deque(maxlen=512))

    @property
    def monitor_uri(self) -> str:
        return f"http://{self.key[0]}:{self.key[2]}"

    def master(self) -> Optional[Master]:
        if self.contact is None:
            return None
        stamp, local = self.beat.stamp.seconds, self.beat.local_stamp.seconds
        contact = self.contact
        return Master(contact.name, contact.uri, stamp, local, self.online, contact.discoverer, self.monitor_uri)


class Discovery:
    """The discovery of one master."""

    def __init__(self, settings: Settings, own_addresses: Iterable[str], rpc_port: int) -> None:
        self.settings = settings
        self.own_addresses = frozenset(own_addresses)
        self.rpc_port = rpc_port
        self.actions: Deque[Action] = deque()
        self.malformed = 0
        self.refused = 0
        self._own: Optional[Master] = None
        self._own_beats: Deque[float] = deque(maxlen=512)
        self._own_since = 0.0
        self._entries: Dict[Key, _Entry] = {}
        self._public: Dict[str, Master] = {}
        self._announce: List[float] = []
        self._request: List[float] = []
        self._ticked: Optional[float] = None
        self._next_beat = 0.0
        self._next_scan = 0.0
        self._answered: Dict[Optional[str], float] = {}

    # What the program tells

    def own_state(self, master: Master, now: float) -> None:
        """The roscore answers, and this is the state of the own master. A changed one is announced, several times."""
        before, self._own = self._own, master
        if before is None:
            self._own_since = now
            self._request = [now + after for after in REPEAT_REQUESTS]
        if (
            before is None
            or not before.online
            or (before.stamp, before.local_stamp) != (master.stamp, master.local_stamp)
        ):
            self._announce = [now + after for after in REPEAT_CHANGES]
        self._publish()
        self.tick(now)

    def own_offline(self, leave: bool) -> None:
        """The roscore does not answer: nothing is announced any more; with `leave` the others are told to forget it."""
        if self._own and self._own.online:
            self._own = Master(**{**self._own.__dict__, "online": False})
            self._announce = []
            self._publish()
        if leave:
            self._to_all(self._record(Kind.LEAVE))

    def leave(self) -> None:
        """The node ends."""
        self._to_all(self._record(Kind.LEAVE))

    def refresh(self, now: float) -> None:
        """Ask everybody for their state now."""
        for host in {entry.key[0] for entry in self._entries.values()}:
            self._send(self._record(Kind.REQUEST), host)
        self._request = [now]
        self.tick(now)

    def datagram(self, data: bytes, source: Tuple[str, int], multicast: bool, now: float) -> None:
        """A datagram arrived. An empty one is a probe of somebody's verification."""
        if not data:
            return
        try:
            beat = decode(data)
        except Malformed as problem:
            self.malformed += 1
            self._say("warning", "malformed", f"a datagram from {source[0]}:{source[1]} is ignored: {problem}")
            return
        if source[0] in self.own_addresses and beat.rpc_port == self.rpc_port:
            if beat.kind is Kind.STATE:
                self._own_beats.append(now)
            return
        key = (source[0], source[1], beat.rpc_port)
        entry = self._entries.get(key)
        if beat.kind is Kind.LEAVE:
            if entry is not None and not entry.leaving:
                entry.leaving, entry.contact_due = 1, now + LEAVE_CHECKS[0]
            return
        if entry is None:
            entry = self._new_entry(key, beat, now)
            if entry is None:
                return
        entry.heard, entry.unanswered = now, 0
        if beat.kind is Kind.REQUEST:
            self._answer(source[0], multicast, now)
            if now - entry.contacted > CONTACT_PAUSE:  # who asks has perhaps just started, as somebody else
                entry.contact_due = now if entry.contact_due is None else entry.contact_due
        else:
            entry.beats.append(now)
            entry.leaving = 0
            if not entry.online and entry.contact is not None:
                entry.contact_due = now
            entry.beat = beat
        if entry.contact is not None and entry.beat.stamp != Stamp():
            self._online(entry)
        self._publish()
        self._contacts(now)

    def contacted(self, key: Key, contact: Optional[Contact], problem: str, now: float) -> None:
        """The result of an Ask: the answer, or None and why."""
        entry = self._entries.get(key)
        if entry is None:
            return
        entry.contacting, entry.contacted, entry.contact_due = False, now, None
        if contact is not None and contact.stamp <= 0.0:
            contact, problem = None, "it has no state yet"
        if entry.leaving:
            self._check_leaving(entry, contact, now)
        elif contact is None:
            no_state = problem == "it has no state yet"
            entry.contact_due = now + (CONTACT_RETRY_NO_STATE if no_state else CONTACT_RETRY)
            if entry.contact is None:
                self._say(
                    "warning",
                    f"contact {key[0]}",
                    f"{entry.monitor_uri} is heard, but does not say who it is: {problem}",
                )
        else:
            self._identify(entry, contact, now)
        self._publish()

    def tick(self, now: float) -> None:
        """Do what is due; at least once a second."""
        asleep = now - self._ticked if self._ticked is not None else 0.0
        self._ticked = now
        if asleep > ASLEEP:
            for entry in self._entries.values():
                entry.heard = min(now, entry.heard + asleep)
        online = self._own is not None and self._own.online
        if online:
            if any(due <= now for due in self._announce) or now >= self._next_beat:
                self._announce = [due for due in self._announce if due > now]
                self._next_beat = now + 1.0 / max(self.settings.heartbeat_hz, 0.02)
                self._to_all(self._record(Kind.STATE))
            if any(due <= now for due in self._request):
                self._request = [due for due in self._request if due > now]
                if self.settings.listen_mcast and self.settings.send_mcast:
                    self._send(self._record(Kind.REQUEST), None)
                for host in self.settings.robot_hosts:
                    self._send(self._record(Kind.REQUEST), host)
        self._contacts(now)
        if now >= self._next_scan:
            self._next_scan = now + SCAN
            self._answered = {host: at for host, at in self._answered.items() if now - at < ANSWER_PAUSE}
            for entry in list(self._entries.values()):
                self._scan(entry, now)
            self._publish()

    def next_tick(self) -> float:
        """The time at which `tick` has something to do."""
        due = [
            entry.contact_due
            for entry in self._entries.values()
            if entry.contact_due is not None and not entry.contacting
        ]
        if self._own is not None and self._own.online:
            due += self._announce + self._request + [self._next_beat]
        return min([self._next_scan] + due)

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
            found.append(Link(self._own.name, quality, now - heard))
        for entry in self._entries.values():
            if entry.contact is not None:
                quality = self._quality(entry.beats, entry.beat.rate, entry.since, now)
                found.append(Link(entry.contact.name, quality, now - entry.heard))
        return found

    # Entries

    def _new_entry(self, key: Key, beat: Heartbeat, now: float) -> Optional[_Entry]:
        if len(self._entries) >= MAX_MASTERS:
            self.refused += 1
            self._say("warning", "full", f"{key[0]} is ignored: {MAX_MASTERS} masters are known already")
            return None
        entry = self._entries[key] = _Entry(key, now, now, beat, contact_due=now)
        return entry

    def _identify(self, entry: _Entry, contact: Contact, now: float) -> None:
        known, entry.contact = entry.contact, contact
        if entry.beat.stamp == Stamp():  # only a request was heard so far
            entry.beat = entry.beat._replace(stamp=Stamp.at(contact.stamp), local_stamp=Stamp.at(contact.stamp))
        if known is None or known.uri != contact.uri:
            if contact.uri == self._own_uri():
                text = (
                    f"{entry.monitor_uri} calls its master {contact.uri}, as this computer calls its own: nothing is"
                    " exchanged with it; set ROS_HOSTNAME or ROS_IP before roscore starts, on both"
                )
                self._say("error", f"same {entry.key[0]}", text)
            for other in self._public.values():
                if other.name == contact.name and other.uri != contact.uri:
                    text = (
                        f"two masters are called {contact.name}: {other.uri} and {contact.uri}; give one another name"
                    )
                    self._say("warning", f"name {contact.name}", text)
        self._online(entry)

    def _online(self, entry: _Entry) -> None:
        entry.online = True

    def _check_leaving(self, entry: _Entry, contact: Optional[Contact], now: float) -> None:
        """After a LEAVE: whoever still answers has not left, whatever a datagram says."""
        if contact is None:
            self._drop(entry)
        elif entry.leaving < len(LEAVE_CHECKS):
            entry.contact_due = now + LEAVE_CHECKS[entry.leaving]
            entry.leaving += 1
        else:
            entry.leaving = 0
            self._say(
                "warning",
                f"leave {entry.key[0]}",
                f"{contact.name} was said to leave, but answers at {entry.monitor_uri}: kept",
            )

    def _drop(self, entry: _Entry) -> None:
        self._entries.pop(entry.key, None)

    def _scan(self, entry: _Entry, now: float) -> None:
        silent, settings = now - entry.heard, self.settings
        if 0 < settings.remove_after < silent or (entry.contact is None and silent > FORGET_UNKNOWN):
            self._drop(entry)
            return
        rate = entry.beat.rate
        if entry.online and rate >= 0.3 and silent > self._interval(rate) * settings.timeout_factor:
            entry.online = False
        if silent > settings.active_request_after:
            if entry.unanswered >= UNANSWERED:
                entry.online = False
            if entry.unanswered < UNANSWERED or now - entry.asked >= settings.active_request_after:
                entry.unanswered, entry.asked = entry.unanswered + 1, now
                crowded = sum(1 for other in self._entries if other[0] == entry.key[0]) > 1
                self._send(self._record(Kind.REQUEST), None if crowded and settings.send_mcast else entry.key[0])

    def _contacts(self, now: float) -> None:
        for entry in self._entries.values():
            if entry.contact_due is not None and entry.contact_due <= now and not entry.contacting:
                entry.contacting = True
                self.actions.append(Ask(entry.key, entry.monitor_uri))

    # What others see

    def _publish(self) -> None:
        """Compare what is known with what was told, and tell the difference.

        Masters are known by their URI here: one that is heard from two addresses is there while one of them is.
        """
        best: Dict[str, Master] = {}
        for entry in self._entries.values():
            master = entry.master()
            if master is not None and (master.uri not in best or (master.online and not best[master.uri].online)):
                best[master.uri] = master
        if self._own is not None:
            best[self._own.uri] = self._own
        if best == self._public:
            return
        before, self._public = self._public, best
        for uri, master in before.items():
            if uri not in best:
                self.actions.append(Event("removed", Master(**{**master.__dict__, "online": False})))
        for uri, master in best.items():
            if uri not in before:
                self.actions.append(Event("new", master))
            elif master != before[uri]:
                self.actions.append(Event("changed", master))

    def _own_uri(self) -> Optional[str]:
        return self._own.uri if self._own else None

    def _interval(self, rate: float) -> float:
        return self.settings.measurement_intervals / min(rate, 1.0)

    def _quality(self, beats: Deque[float], rate: float, since: float, now: float) -> float:
        if rate < 0.1:
            return -1.0
        window = min(self._interval(rate), max(now - since, 1.0 / rate))
        received = sum(1 for at in beats if now - at <= window)
        return min(100.0, 100.0 * received / (rate * window))

    # Datagrams

    def _record(self, kind: Kind) -> bytes:
        if kind is not Kind.STATE or self._own is None:
            return encode(Heartbeat(kind, self.rpc_port))
        stamp, local = Stamp.at(self._own.stamp), Stamp.at(self._own.local_stamp)
        return encode(Heartbeat(kind, self.rpc_port, self.settings.heartbeat_hz, stamp, local))

    def _answer(self, host: str, multicast: bool, now: float) -> None:
        if self._own is None or not self._own.online:
            return
        group: Tuple[Optional[str], ...] = (None,) if multicast and self.settings.send_mcast else ()
        for target in group + (host,):
            if now - self._answered.get(target, now - 1.0) >= ANSWER_PAUSE:
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
        if host is None or host not in self.own_addresses:
            self.actions.append(Send(datagram, host))

    def _say(self, level: str, topic: str, text: str) -> None:
        self.actions.append(Say(level, topic, text))
