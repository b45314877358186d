# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause
"""A helper of multicast_verify without its sockets: datagrams and times in, datagrams out, at the end a result.

Every computer's helper sends empty datagrams ("probes") to the group: a discovery node ignores an empty datagram
silently. An empty datagram names no sender, so a probe is known by its source. Each helper sends its probes from the
socket on which it speaks with the other helpers. So the source of a probe is also the place to ask: how many of mine
have you heard?
"""

import collections
import typing

from .messages import ANSWER, ASK, HELLO, Message, decode, encode

IDLE = 0.5  # seconds between the probes of a helper that only waits: the others hear it, whenever they are asked
SETTLE = 0.3  # seconds that a probe has to arrive; access points hold multicast back for some 0.1 to 0.3 s
PATIENCE = 0.2  # seconds after which a count is asked for again
ATTEMPTS = 8  # so often: then a count comes back through 30 % loss in both directions
SILENT = 10.0  # seconds after which a helper that is no longer heard is not waited for
TIMES = 3  # times that a helper introduces itself, or says that it is done, because any datagram can be lost
ANSWERS = 40  # answers per second and computer; more would be a flood of another program
LATEST = 1 << 32  # seconds since 1970 that no clock shows, so no two clocks differ by more
SOURCES = 4096  # kept of each peer, and of all strangers together; more would be a flood of another program
ANY_PORT = 0  # a stranger counts by its address: its ports are no sources of their own
PORTS = 8  # ports of one address to which a helper introduces itself at a time


Address = typing.Tuple[str, int]  # IPv4 address and port
Datagrams = typing.List[typing.Tuple[bytes, Address]]  # payload and destination; all leave from the one socket
Steps = typing.Iterator[typing.Tuple[float, Datagrams]]  # seconds until the next step, and the datagrams of this one


class HelperSettings(typing.NamedTuple):
    """The settings with which a helper is started."""

    run: str
    group: str
    port: int
    interface: str  # the name of the interface that has `address`
    address: str
    own: typing.Tuple[str, ...]  # all addresses of this computer
    computers: typing.Dict[str, str]  # address -> name
    lifetime: float  # seconds
    # The addresses of computers that the group does not reach, as behind a gateway; they are met only by unicast.
    apart: typing.FrozenSet[str] = frozenset()


BEFORE, DURING, AFTER = "before", "during", "after"  # the time at which a peer was asked, seen from the rounds


class HeardCounts(typing.NamedTuple):
    """A peer's answer: of `sent` probes on the group it has heard `heard`, both since the helpers were started."""

    sent: int
    heard: int
    heard_unicast: int


class GroupPeer:
    """One other computer."""

    def __init__(self, name: str, address: str) -> None:
        self.name = name
        self.address = address
        self.control: typing.Optional[Address] = None  # the source of its messages
        self.seen: typing.Optional[float] = None  # the time at which anything of it was last heard
        self.done = False
        self.source: typing.Optional[str] = None  # the address from which it sees this computer
        self.forget()

    def forget(self) -> None:
        """Begin a new measurement."""
        # sequence -> (BEFORE, DURING or AFTER, monotonic time, probes sent until then)
        self.asks: typing.Dict[int, typing.Tuple[str, float, int]] = {}
        self.samples: typing.List[typing.Tuple[float, float]] = []  # (round-trip time, clock offset) in seconds
        self.accounts: typing.Dict[str, HeardCounts] = {}  # BEFORE, DURING or AFTER -> its latest one


class Counts(typing.Counter[typing.Any]):
    """Counts by source. Each peer has places of its own, and all strangers together: no sender takes the place of another."""

    def __init__(self) -> None:
        super().__init__()
        self.places: typing.Counter[str] = collections.Counter()  # the name of a peer, empty for strangers -> sources

    def count(self, key: typing.Any, source: Address, peer: typing.Optional[GroupPeer], number: int = 1) -> None:
        """Count the datagrams of a source.

        Anybody can send in the name of a peer, but not with the seal of its messages: datagrams from there always count.
        """
        owner = peer.name if peer else ""
        if key not in self:
            self.places[owner] += 1
        if key in self or self.places[owner] <= SOURCES or (peer and source == peer.control):
            self[key] += number


class Helper:
    """A helper without its sockets.

    now: monotonic seconds. wall: seconds of the wall clock, which is compared with other wall clocks only.
    """

    def __init__(self, settings: HelperSettings, now: float) -> None:
        self.settings = settings
        self.peers = {
            address: GroupPeer(name, address)
            for address, name in settings.computers.items()
            if address != settings.address
        }
        self.aliases: typing.Dict[str, GroupPeer] = {}  # other source addresses of a peer, behind address translation
        self.heard = Counts()  # (address, port, interface) -> probes on the group
        self.strangers = Counts()  # address, interface -> datagrams on the group from outside the fleet
        self.heard_unicast = Counts()  # address and port -> probes to this computer itself
        self.callers = Counts()  # address -> empty datagrams to this computer itself, from any source
        self.introductions: typing.Dict[Address, int] = {}  # destination -> introductions that are still to be sent
        self.budget = (0, 0)  # (second, answers given in it)
        self.sent = 0
        self.sequence = 0
        self.rounds: typing.Optional[Steps] = None  # the measurement under way
        self.done = False
        self.due = now
        self.deadline = now + settings.lifetime
        self.now = now
        self.wall = 0.0

    # Arrivals

    def datagram(self, now: float, source: Address, destination: str, interface: str, length: int) -> Datagrams:
        """Take in a UDP datagram for the group's port; `length` is that of its payload, in bytes."""
        address, group = source[0], self.settings.group
        if address in self.settings.own or destination not in (group, self.settings.address):
            return []
        peer = self._peer_at(address)
        if destination == group:
            self.heard.count((address, source[1] if peer else ANY_PORT, interface), source, peer, int(not length))
            if peer is None:
                self.strangers.count((address, interface), source, peer)
        elif not length:
            self.callers.count(address, source, peer)
            if peer:
                self.heard_unicast.count(source, source, peer)
        if peer is None or length:
            return []
        peer.seen, peer.control = now, peer.control or source
        return self._introduce(source)

    def message(self, now: float, wall: float, source: Address, data: bytes) -> Datagrams:
        """Take in a datagram that came to the socket on which helpers speak with each other."""
        message = decode(data, self.settings.run)
        peer = self.peers.get(message.address) if message else None
        if message is None or peer is None:
            return []
        peer.done = message.done or (peer.done and source == peer.control)
        peer.seen, peer.control = now, source
        if source[0] not in self.settings.computers:
            self.aliases[source[0]] = peer
        if message.kind == ASK and self._may_answer(now):
            answer = self._message(
                ANSWER,
                sequence=message.sequence,
                heard=self.heard[source + (self.settings.interface,)],
                heard_unicast=self.heard_unicast[source],
                source=source[0],
                asked=message.asked,
                arrived=wall,
            )
            return [(answer, source)]
        if message.kind == ANSWER and message.sequence in peer.asks:
            when, asked, sent = peer.asks.pop(message.sequence)
            peer.accounts[when] = HeardCounts(sent, message.heard, message.heard_unicast)
            peer.source = message.source
            offset = ((message.arrived - message.asked) + (message.arrived - wall)) / 2  # RFC 5905, section 8
            if abs(offset) < LATEST:  # else the whole answer of this computer would be refused
                peer.samples.append((now - asked, offset))
        return []

    def _peer_at(self, address: str) -> typing.Optional[GroupPeer]:
        return self.peers.get(address) or self.aliases.get(address)

    def _apart(self, address: str) -> bool:
        """Return True if the group, by plan, does not pass between this computer and another one."""
        return bool({address, self.settings.address} & self.settings.apart)

    def _may_answer(self, now: float) -> bool:
        second, answers = self.budget
        answers = answers + 1 if second == int(now) else 1
        self.budget = (int(now), answers)
        return answers <= ANSWERS * len(self.settings.computers)

    def _introduce(self, source: Address) -> Datagrams:
        """Introduce this helper to a new source: it may not hear us on the group, and could not ask us otherwise.

        If its address has too many ports, the first one that has got all introductions makes room: most may be forged.
        """
        ports = [other for other in self.introductions if other[0] == source[0]]
        if source in ports:
            return []
        if len(ports) >= PORTS:
            spent = [other for other in ports if not self.introductions[other]]
            if not spent:
                return []
            del self.introductions[spent[0]]
        self.introductions[source] = TIMES
        return self._make_hello(source)

    # Sending

    def measure(self, now: float, rounds: int, interval: float, unicast: bool) -> None:
        """Begin a measurement, unless one is under way; the measurement is over when `rounds` is None again."""
        if self.rounds is None:
            self.rounds = self._measurement(rounds, interval, unicast)
            self.due = now

    def poll(self, now: float, wall: float) -> Datagrams:
        """Return the datagrams that are due at this time."""
        if now < self.due:
            return []
        self.now, self.wall = now, wall
        if self.rounds is not None:
            try:
                pause, datagrams = next(self.rounds)
                self.due = now + pause
                return datagrams
            except StopIteration:
                self.rounds, self.done = None, True
                self.introductions.update((peer.control, TIMES) for peer in self.peers.values() if peer.control)
        self.due = now + IDLE
        return self._probes(False) + [
            hello for source in list(self.introductions) for hello in self._make_hello(source)
        ]

    def _measurement(self, rounds: int, interval: float, unicast: bool) -> Steps:
        """Take the steps of a measurement.

        Loss comes from the counts before and after the rounds, when no probe is under way. The questions in between are
        for the times.
        """
        for peer in self.peers.values():
            peer.forget()
        yield SETTLE, []
        yield from self._counts(BEFORE)
        for number in range(rounds):
            yield interval, self._probes(unicast) + self._asks(self.peers.values(), DURING)
        yield SETTLE, []
        yield from self._counts(AFTER)

    def _counts(self, when: str) -> Steps:
        """Ask every peer how many probes it has heard, until all have answered, or an answer is no longer likely."""
        for attempt in range(ATTEMPTS):
            late = [peer for peer in self.peers.values() if when not in peer.accounts]
            if not any(peer.control for peer in late):
                return
            yield PATIENCE, self._asks(late, when)

    def _probes(self, unicast: bool) -> Datagrams:
        """Send one probe on the group, and one by unicast to each computer that is to hear that too, or can only hear that."""
        port = self.settings.port
        self.sent += 1
        singly = [address for address in self.peers if unicast or self._apart(address)]
        return [(b"", (self.settings.group, port))] + [(b"", (address, port)) for address in singly]

    def _asks(self, peers: typing.Iterable[GroupPeer], when: str) -> Datagrams:
        asks: Datagrams = []
        for peer in peers:
            if peer.control:
                self.sequence += 1
                peer.asks[self.sequence] = (when, self.now, self.sent)
                asks.append((self._message(ASK, sequence=self.sequence, asked=self.wall), peer.control))
        return asks

    def _make_hello(self, source: Address) -> Datagrams:
        if not self.introductions[source]:
            return []
        self.introductions[source] -= 1
        return [(self._message(HELLO), source)]

    def _message(self, kind: int, **fields: typing.Any) -> bytes:
        return encode(Message(kind, self.done, self.settings.address, **fields), self.settings.run)

    def is_over(self, now: float) -> bool:
        """Return True if this helper is no longer needed: its time is up, or it is done and no other helper waits for it."""
        if self.rounds is not None:
            return False
        waiting = any(
            not peer.done and now - peer.seen < SILENT for peer in self.peers.values() if peer.seen is not None
        )
        # Only of the peers: forged sources come as long as their sender likes.
        introducing = any(self.introductions.get(peer.control) for peer in self.peers.values() if peer.control)
        return now >= self.deadline or (self.done and not waiting and not introducing)

    # The result

    def result(self) -> typing.Dict[str, typing.Any]:
        """Return the measurement as the module does: udp, heard, missing, unanswered, unexpected, callers."""
        udp = [self._entry(peer) for peer in self.peers.values()]
        together = [entry for entry in udp if entry["multicast"]]
        return {
            "udp": udp,
            "heard": [entry["name"] for entry in udp if entry["heard_from"]],
            "missing": _list_missing(udp),
            "unanswered": [entry["name"] for entry in together if entry["heard_from"] and entry["heard_by"] is None],
            # An address may have become that of a peer since.
            "unexpected": [
                {"address": address, "interface": interface, "datagrams": count}
                for (address, interface), count in sorted(self.strangers.items())
                if self._peer_at(address) is None
            ],
            # empty datagrams to this computer itself
            "callers": [{"address": address, "datagrams": count} for address, count in sorted(self.callers.items())],
        }

    def _entry(self, peer: GroupPeer) -> typing.Dict[str, typing.Any]:
        probes = [
            (interface, address, count)
            for (address, port, interface), count in self.heard.items()
            if self._peer_at(address) is peer and count
        ]
        planned = self.settings.interface
        heard = sum(count for interface, address, count in probes if interface == planned)
        translated = sorted({address for interface, address, count in probes} - {peer.address})
        after = peer.accounts.get(AFTER) or peer.accounts.get(DURING)
        heard_by, loss = self._rate_reception(peer, after)
        return dict(
            name=peer.name,
            address=peer.address,
            multicast=not self._apart(peer.address),
            heard_from=heard > 0,
            heard=heard,
            source_address=(translated or [peer.address])[0] if probes else None,
            other_interfaces=sorted({interface for interface, address, count in probes} - {planned}),
            heard_by=heard_by,
            loss=loss,
            own_source_address=peer.source,
            unicast=after.heard_unicast > 0 if after else None,
            **times(peer.samples),
        )

    def _rate_reception(
        self, peer: GroupPeer, after: typing.Optional[HeardCounts]
    ) -> typing.Tuple[typing.Optional[bool], typing.Optional[float]]:
        """Return True if a peer hears this computer on the group, and which share of the probes was lost; None if unknown."""
        before = peer.accounts.get(BEFORE)
        if after is None or self._apart(peer.address):  # by plan it does not hear this computer on the group
            return None, None
        if before and after.sent > before.sent:
            arrived = after.heard - before.heard
            return arrived > 0, round(max(0.0, 1 - arrived / (after.sent - before.sent)), 3)
        return after.heard > 0, None


def times(samples: typing.List[typing.Tuple[float, float]]) -> typing.Dict[str, typing.Any]:
    """Compute rtt_ms (min, median, max) and clock_offset_s out of (round-trip time, offset) in seconds; None without any.

    The offset is that of the quickest round trip: its error is at most half of that time (RFC 5905, section 8).
    """
    if not samples:
        return {"rtt_ms": None, "clock_offset_s": None}
    trips = sorted(round(trip * 1000, 3) for trip, offset in samples)
    rtt = {"min": trips[0], "median": trips[len(trips) // 2], "max": trips[-1]}
    return {"rtt_ms": rtt, "clock_offset_s": round(min(samples)[1], 4)}


def _list_missing(udp: typing.List[typing.Dict[str, typing.Any]]) -> typing.List[str]:
    """List the computers that are not heard, or do not hear; of those without multicast, the ones that did not answer."""
    lost = [entry for entry in udp if entry["multicast"] and (not entry["heard_from"] or entry["heard_by"] is False)]
    lost += [entry for entry in udp if not entry["multicast"] and not entry["unicast"]]
    return [entry["name"] for entry in lost]
