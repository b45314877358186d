# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause
"""What multicast_verify knows without a socket or a clock: the kernel's tables, the record, the accounting.

Every computer's helper sends empty datagrams ("probes") to the group: a discovery node ignores an empty datagram
silently. An empty datagram names nobody, so a probe is known by its source. Each helper sends its probes from the
same socket on which it speaks with the other helpers, so the source of a probe is also where to ask: how many of mine
have you heard?
"""

import hashlib
import hmac
import re
import socket
import struct
import sys
from typing import NamedTuple

IDLE = 0.5  # seconds between the probes of a helper that only waits: the others hear it, whenever they are asked
SETTLE = 0.3  # seconds that a probe has to arrive; access points hold multicast back for some 0.1 to 0.3 s
PATIENCE = 0.2  # seconds after which a count is asked for again
ATTEMPTS = 8  # how often, so that it comes back through 30 % loss in both directions
SILENT = 10.0  # seconds after which a helper that is no longer heard is not waited for
TELLS = 3  # how often a helper introduces itself, or says that it is done, because any datagram can be lost
ANSWERS = 40  # answers per second and computer; more would be somebody else's flood
SOURCES = 4096  # (address, port, interface) kept; more would be somebody else's flood
PORTS = 8  # ports of one address to which a helper introduces itself


# The kernel's tables


def igmp_memberships(text, byteorder=sys.byteorder):
    """Memberships of /proc/net/igmp: a list of interface, family, group, users and querier.

    The kernel prints a group as the 32-bit number that its bytes make in memory, so the machine's byte order counts.
    "querier" is the version that was last heard (or the interface's own), not a proof that a querier lives.
    """
    found, interface, querier = [], None, None
    for line in text.splitlines():
        device = re.match(r"\d+\s+(\S+?)\s*:\s*\d+\s+(\S+)", line)
        group = re.match(r"\s+([0-9A-Fa-f]{8})\s+(\d+)\s", line)
        if device:
            interface, querier = device.groups()
        elif group and interface:
            address = socket.inet_ntoa(int(group.group(1), 16).to_bytes(4, byteorder))
            found.append(
                {
                    "interface": interface,
                    "family": "ipv4",
                    "group": address,
                    "users": int(group.group(2)),
                    "querier": querier,
                }
            )
    return found


def igmp6_memberships(text):
    """Memberships of /proc/net/igmp6, in the form of igmp_memberships (the table names no querier)."""
    rows = re.findall(r"^\d+\s+(\S+)\s+([0-9a-f]{32})\s+(\d+)\s", text, re.MULTILINE)
    return [
        {
            "interface": interface,
            "family": "ipv6",
            "group": socket.inet_ntop(socket.AF_INET6, bytes.fromhex(group)),
            "users": int(users),
            "querier": None,
        }
        for interface, group, users in rows
    ]


def without_own(memberships, interface, group):
    """The same memberships without one user of (interface, group): the membership that the measurement itself made."""
    others = []
    for item in memberships:
        own = (item["interface"], item["group"]) == (interface, group)
        users = item["users"] - 1 if own else item["users"]
        if users > 0:
            others.append(dict(item, users=users))
    return others


def interface_addresses(text):
    """{IPv4 address: (index, name)} from the output of `ip -oneline -4 address show`."""
    rows = re.findall(r"^(\d+):\s+([^\s@]+)\S*\s+inet\s+([\d.]+)", text, re.MULTILINE)
    return {address: (int(index), name) for index, name, address in rows}


def route_of(text):
    """(device, source address) from the output of `ip route get ADDRESS`; None for what it does not say."""
    device, source = (re.search(rf"\b{word} (\S+)", text) for word in ("dev", "src"))
    return device and device.group(1), source and source.group(1)


# Packets


class Packet(NamedTuple):
    """One IPv4 packet as a raw socket returns it."""

    source: str
    destination: str
    body: bytes


def packet(data):
    """Split an IPv4 packet (RFC 791, section 3.1) into a Packet; None when it is too short to be one."""
    length = (data[0] & 0x0F) * 4 if data else 0
    if length < 20 or len(data) < length:
        return None
    return Packet(socket.inet_ntoa(data[12:16]), socket.inet_ntoa(data[16:20]), data[length:])


def checksum(data):
    """The Internet checksum (RFC 1071) of bytes."""
    data += b"\0" * (len(data) % 2)
    total = sum(struct.unpack(f"!{len(data) // 2}H", data))
    while total >> 16:
        total = (total & 0xFFFF) + (total >> 16)
    return ~total & 0xFFFF


def echo_request(identifier, sequence):
    """An ICMP echo request (RFC 792) without data."""
    head = struct.pack("!BBHHH", 8, 0, 0, identifier, sequence)
    return head[:2] + struct.pack("!H", checksum(head)) + head[4:]


def echo_reply(data, identifier):
    """(source address, sequence) of an IPv4 packet that is an ICMP echo reply to identifier, else None."""
    found = packet(data)
    if found is None or len(found.body) < 8:
        return None
    kind, code, echoed, sequence = struct.unpack("!BB2xHH", found.body[:8])
    return (found.source, sequence) if (kind, code, echoed) == (0, 0, identifier) else None


# The record that helpers exchange: of one size, so that an answer is never larger than its question

HELLO, ASK, ANSWER = 1, 2, 3
_BODY = struct.Struct("!4sBB2x4sIII4sdd")
_MAGIC = b"RFMV"
_SEAL = 16


class Record(NamedTuple):
    """address: the sender's planned address. heard: the receiver's probes that the sender has heard.
    source: the address from which the sender sees the receiver. Times are the wall clocks, in seconds."""

    kind: int
    done: bool
    address: str
    sequence: int = 0
    heard: int = 0
    heard_unicast: int = 0
    source: str = "0.0.0.0"
    asked: float = 0.0
    arrived: float = 0.0


def _seal(body, run):
    return hmac.new(run.encode(), body, hashlib.sha256).digest()[:_SEAL]


def encode(record, run):
    """Record -> bytes, sealed with the label of the run: helpers of another run, and strangers, are not understood."""
    fields = record._replace(address=socket.inet_aton(record.address), source=socket.inet_aton(record.source))
    body = _BODY.pack(_MAGIC, *fields)
    return _seal(body, run) + body


def decode(data, run):
    """bytes -> Record, or None when it is no record of this run."""
    body = data[_SEAL:]
    if len(body) != _BODY.size or not hmac.compare_digest(data[:_SEAL], _seal(body, run)):
        return None
    magic, kind, done, address, sequence, heard, unicast, source, asked, arrived = _BODY.unpack(body)
    addresses = socket.inet_ntoa(address), socket.inet_ntoa(source)
    record = Record(kind, bool(done), addresses[0], sequence, heard, unicast, addresses[1], asked, arrived)
    return record if magic == _MAGIC else None


# The accounting


class Settings(NamedTuple):
    """What a helper is started with. interface: name of the interface that has address. computers: {address: name}.
    apart: the addresses of those whom the group does not reach, as behind a gateway; they are met by unicast alone."""

    run: str
    group: str
    port: int
    interface: str
    address: str
    own: tuple
    computers: dict
    lifetime: float
    apart: frozenset = frozenset()


BEFORE, DURING, AFTER = "before", "during", "after"  # the rounds: when a peer was asked


class Account(NamedTuple):
    """A peer's answer: of `sent` probes on the group it has heard `heard`, both since the helpers were started."""

    sent: int
    heard: int
    heard_unicast: int


class Peer:
    """One other computer."""

    def __init__(self, name, address):
        self.name = name
        self.address = address
        self.control = None  # (address, port) where its records come from
        self.seen = None  # when anything of it was last heard
        self.done = False
        self.source = None  # from which address it sees this computer
        self.forget()

    def forget(self):
        """A new measurement begins."""
        self.asks = {}  # sequence -> (when, monotonic time, probes sent until then)
        self.samples = []  # (round-trip time, clock offset) in seconds
        self.accounts = {}  # when -> its latest Account


class Helper:
    """A helper without its sockets: datagrams and times in, datagrams out, at the end a result.

    Datagrams are returned as a list of (payload, (address, port)); all are to be sent from the one socket.
    now: monotonic seconds; wall: seconds of the wall clock, which is only ever compared with other wall clocks.
    """

    def __init__(self, settings, now):
        self.settings = settings
        self.peers = {
            address: Peer(name, address) for address, name in settings.computers.items() if address != settings.address
        }
        self.aliases = {}  # other source addresses of a peer, behind address translation
        self.heard = {}  # (address, port, interface) -> [probes, datagrams] on the group
        self.heard_unicast = {}  # (address, port) -> probes
        self.callers = {}  # address -> empty datagrams to this computer itself, whoever sent them
        self.telling = {}  # (address, port) -> how often it is still to be told who we are
        self.budget = (0, 0)  # (second, answers given in it)
        self.sent = 0
        self.sequence = 0
        self.rounds = None  # the measurement under way
        self.awaited = set()  # the peers without whose counts it does not go on, for a while
        self.done = False
        self.due = now
        self.deadline = now + settings.lifetime
        self.now = now
        self.wall = 0.0

    # what arrives

    def datagram(self, now, source, destination, interface, length):
        """A UDP datagram for the group's port arrived. source: (address, port); length: of its payload, in bytes."""
        address, group = source[0], self.settings.group
        if address in self.settings.own or destination not in (group, self.settings.address):
            return []
        peer = self._peer_at(address)
        if destination == group:
            key = source + (interface,)
            if key in self.heard or len(self.heard) < SOURCES:
                counts = self.heard.setdefault(key, [0, 0])
                counts[0] += not length
                counts[1] += 1
        elif not length:
            if address in self.callers or len(self.callers) < SOURCES:
                self.callers[address] = self.callers.get(address, 0) + 1
            if peer and (source in self.heard_unicast or len(self.heard_unicast) < SOURCES):
                self.heard_unicast[source] = self.heard_unicast.get(source, 0) + 1
        if peer is None or length:
            return []
        peer.seen, peer.control = now, peer.control or source
        return self._introduce(source)

    def record(self, now, wall, source, data):
        """A datagram arrived from (address, port) at the socket on which helpers speak with each other."""
        record = decode(data, self.settings.run)
        peer = record and self.peers.get(record.address)
        if not peer:
            return []
        peer.done = record.done or (peer.done and source == peer.control)
        peer.seen, peer.control = now, source
        if source[0] not in self.settings.computers:
            self.aliases[source[0]] = peer
        if record.kind == ASK and self._may_answer(now):
            heard = self.heard.get(source + (self.settings.interface,), [0])[0]
            answer = self._record(
                ANSWER,
                sequence=record.sequence,
                heard=heard,
                heard_unicast=self.heard_unicast.get(source, 0),
                source=source[0],
                asked=record.asked,
                arrived=wall,
            )
            return [(answer, source)]
        if record.kind == ANSWER and record.sequence in peer.asks:
            when, asked, sent = peer.asks.pop(record.sequence)
            peer.accounts[when] = Account(sent, record.heard, record.heard_unicast)
            peer.source = record.source
            offset = ((record.arrived - record.asked) + (record.arrived - wall)) / 2  # RFC 5905, section 8
            peer.samples.append((now - asked, offset))
            self._answered(peer, now)
        return []

    def _peer_at(self, address):
        return self.peers.get(address) or self.aliases.get(address)

    def _apart(self, address):
        """Does the group, by plan, not pass between this computer and another one?"""
        return bool({address, self.settings.address} & self.settings.apart)

    def _may_answer(self, now):
        second, given = self.budget
        given = given + 1 if second == int(now) else 1
        self.budget = (int(now), given)
        return given <= ANSWERS * len(self.settings.computers)

    def _introduce(self, source):
        """Tell a new source who is here: it may not hear us on the group, and could not ask us otherwise."""
        ports = sum(1 for address, port in self.telling if address == source[0])
        if source in self.telling or ports >= PORTS:
            return []
        self.telling[source] = TELLS
        return self._tell(source)

    # what is sent, and when

    def measure(self, now, rounds, interval, unicast):
        """Begin a measurement, if none is under way; it is over when `rounds` is None again."""
        if self.rounds is None:
            self.rounds = self._measurement(rounds, interval, unicast)
            self.due = now

    def poll(self, now, wall):
        """What is due at this time."""
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
                self.telling.update((peer.control, TELLS) for peer in self.peers.values() if peer.control)
        self.due = now + IDLE
        return self._probes(False) + [told for source in list(self.telling) for told in self._tell(source)]

    def _measurement(self, rounds, interval, unicast):
        """The steps: (seconds until the next, datagrams). Loss comes from the counts before and after the rounds,
        when no probe is under way; the questions in between are for the times."""
        for peer in self.peers.values():
            peer.forget()
        yield SETTLE, []
        yield from self._counts(BEFORE)
        for number in range(rounds):
            yield interval, self._probes(unicast) + self._asks(self.peers.values(), DURING)
        yield SETTLE, []
        yield from self._counts(AFTER)

    def _counts(self, when):
        """Ask every peer how many probes it has heard, until all have answered or none is likely to."""
        for attempt in range(ATTEMPTS):
            late = [peer for peer in self.peers.values() if when not in peer.accounts]
            self.awaited = {peer for peer in late if peer.control}
            if not self.awaited:
                return
            yield PATIENCE, self._asks(late, when)
        self.awaited = set()

    def _answered(self, peer, now):
        if peer in self.awaited:
            self.awaited.remove(peer)
            if not self.awaited:
                self.due = now

    def _probes(self, unicast):
        """One probe on the group, and one to each computer that is to hear it by unicast too, or can only so."""
        port = self.settings.port
        self.sent += 1
        singly = [address for address in self.peers if unicast or self._apart(address)]
        return [(b"", (self.settings.group, port))] + [(b"", (address, port)) for address in singly]

    def _asks(self, peers, when):
        asks = []
        for peer in peers:
            if peer.control:
                self.sequence += 1
                peer.asks[self.sequence] = (when, self.now, self.sent)
                asks.append((self._record(ASK, sequence=self.sequence, asked=self.wall), peer.control))
        return asks

    def _tell(self, source):
        if not self.telling[source]:
            return []
        self.telling[source] -= 1
        return [(self._record(HELLO), source)]

    def _record(self, kind, **fields):
        return encode(Record(kind, self.done, self.settings.address, **fields), self.settings.run)

    def over(self, now):
        """Is this helper no longer needed? It ends when its time is up, or when nobody is left that needs it."""
        if self.rounds is not None:
            return False
        waiting = any(
            not peer.done and now - peer.seen < SILENT for peer in self.peers.values() if peer.seen is not None
        )
        return now >= self.deadline or (self.done and not waiting and not any(self.telling.values()))

    # what comes out

    def result(self):
        """The measurement as the module returns it: udp, heard, missing, unanswered, unexpected, callers."""
        udp = [self._entry(peer) for peer in self.peers.values()]
        together = [entry for entry in udp if entry["multicast"]]
        strangers = {}
        for (address, port, interface), counts in self.heard.items():
            if self._peer_at(address) is None:
                strangers[address, interface] = strangers.get((address, interface), 0) + counts[1]
        return {
            "udp": udp,
            "heard": [entry["name"] for entry in udp if entry["heard_from"]],
            "missing": [entry["name"] for entry in together if not entry["heard_from"] or entry["heard_by"] is False]
            + [entry["name"] for entry in udp if not entry["multicast"] and not entry["unicast"]],
            "unanswered": [entry["name"] for entry in together if entry["heard_from"] and entry["heard_by"] is None],
            "unexpected": [
                {"address": address, "interface": interface, "datagrams": count}
                for (address, interface), count in sorted(strangers.items())
            ],
            "callers": [{"address": address, "datagrams": count} for address, count in sorted(self.callers.items())],
        }

    def _entry(self, peer):
        probes = [
            (interface, address, counts[0])
            for (address, port, interface), counts in self.heard.items()
            if self._peer_at(address) is peer and counts[0]
        ]
        planned = self.settings.interface
        heard = sum(count for interface, address, count in probes if interface == planned)
        translated = sorted({address for interface, address, count in probes} - {peer.address})
        before, after = peer.accounts.get(BEFORE), peer.accounts.get(AFTER) or peer.accounts.get(DURING)
        loss = heard_by = None
        if self._apart(peer.address):
            pass  # it is not to hear this computer on the group
        elif before and after and after.sent > before.sent:
            arrived = after.heard - before.heard
            heard_by, loss = arrived > 0, round(max(0.0, 1 - arrived / (after.sent - before.sent)), 3)
        elif after:
            heard_by = after.heard > 0
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


def times(samples):
    """rtt_ms (min, median, max) and clock_offset_s from (round-trip time, offset) pairs in seconds; None without any.

    The offset is that of the quickest round trip: its error is at most half of that time (RFC 5905, section 8).
    """
    if not samples:
        return {"rtt_ms": None, "clock_offset_s": None}
    trips = sorted(round(trip * 1000, 3) for trip, offset in samples)
    rtt = {"min": trips[0], "median": trips[len(trips) // 2], "max": trips[-1]}
    return {"rtt_ms": rtt, "clock_offset_s": round(min(samples)[1], 4)}


def icmp_round(number, answered, computers, own):
    """One ICMP round as the module returns it. answered: source addresses; computers: {address: name}."""
    others = {address: name for address, name in computers.items() if address != own}
    return {
        "round": number,
        "answered": [name for address, name in others.items() if address in answered],
        "missing": [name for address, name in others.items() if address not in answered],
        "unexpected": sorted(set(answered) - set(computers)),
    }


# What to say about what was missing: {names} and {port} are filled in, a line without names is left out
CAUSES = (
    ("silent", "Not heard on the group: {names}."),
    ("deaf", "Do not hear this computer on the group: {names}."),
    ("elsewhere", "Heard on another interface than the planned one: {names}; check the addresses and the cabling."),
    (
        "reachable",
        (
            "Unicast datagrams reach {names}, so something drops only the group: IGMP snooping without a querier, "
            "an access point's multicast filter, or a firewall rule for the group."
        ),
    ),
    (
        "unreachable",
        (
            "No answer came from {names}: the computer is down, no helper was started there, its address or interface "
            "is not the planned one, or a firewall closes UDP port {port}."
        ),
    ),
    (
        "unanswered",
        "Heard, but whether they hear this computer is open, as no count came back: {names}; their own result tells.",
    ),
)


def explain(result, port):
    """One message on a result: who is missing, and what usually causes just this."""
    udp = result["udp"]
    if not result["missing"] and not result["unanswered"]:
        alone = sum(1 for entry in udp if not entry["multicast"])
        more = f", {alone} of them by unicast, since the group does not pass between them" if alone else ""
        return f"Every other computer ({len(udp)}) is heard on the group and hears this one{more}."
    silent = [entry for entry in udp if entry["multicast"] and not entry["heard_from"]]
    alone = [entry for entry in udp if not entry["multicast"] and not entry["unicast"]]
    cases = {
        "silent": [entry["name"] for entry in silent],
        "deaf": [entry["name"] for entry in udp if entry["heard_by"] is False],
        "elsewhere": [
            "{} ({})".format(entry["name"], ", ".join(entry["other_interfaces"]))
            for entry in silent
            if entry["other_interfaces"]
        ],
        "reachable": [entry["name"] for entry in udp if entry["name"] in result["missing"] and entry["unicast"]],
        "unreachable": [entry["name"] for entry in silent + alone if entry["heard_by"] is None],
        "unanswered": result["unanswered"],
    }
    return " ".join(text.format(names=", ".join(cases[case]), port=port) for case, text in CAUSES if cases[case])
