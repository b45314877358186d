# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""A topic on its way: connections to its publishers, while there are listeners, and to the listeners.

A message on any of the first goes to all of the second. A latched publisher's last message is for later listeners, too.
"""

from functools import partial
from typing import Any, Callable, Dict, Hashable, List, Mapping, NamedTuple, Optional, Tuple

from ..edge.clock import monotonic
from ..edge.loop import Loop
from ..edge.process import program
from ..protocol.filters import MAX_NAME
from ..protocol.plain_text import plain, quote
from ..protocol.tcpros.header import encode_header
from .account import Account
from .core.budget import Budget, weigh_fields
from .core.definition import DefinitionError
from .core.frames import Change, FramesError, Rewrite, make_rewrite
from .core.rates import NO_RATE, Rate, find_unknown, make_throttle
from .dial import Dialers
from .wire import PATIENCE, Wire

_NAMES = ("type", "md5sum", "latching")
_FIELDS = (*_NAMES, "message_definition")  # of a publisher's header that are kept
AGAIN = (0.2, 1.5)  # seconds until a publisher that does not answer is asked again: at first, and at most

Fields = Dict[str, str]
Dial = Callable[[], Any]  # makes a connection to a publisher. It may block, and raises OSError or ValueError.


def ask_for(node: str, topic: str) -> Fields:
    """Return the header with which a node asks for a topic."""
    return {"callerid": node, "topic": topic, "type": "*", "md5sum": "*", "tcp_nodelay": "1"}


class BusLink(NamedTuple):
    """A connection, as getBusInfo and getBusStats report it (wiki.ros.org/ROS/Slave_API)."""

    number: int
    peer: str  # the URI of a publisher, or the name of who listens
    inward: bool
    topic: str
    title: str
    size: int  # bytes that have been sent
    messages: int


class Origin(NamedTuple):
    """The way to a publisher, and the treatment of its messages."""

    dial: Dial
    uri: str  # of its slave API
    question: Fields  # our header
    account: Account  # of its robot
    change: Optional[Change] = None  # of the frames in its messages


class _Source:
    """A publisher."""

    def __init__(self, origin: Origin) -> None:
        self.origin = origin
        self.rewrite: Optional[Rewrite] = None
        self.problem = ""  # with the definition of its messages, for which they stay away
        self.wire: Optional[Wire] = None
        self.header: Optional[Fields] = None
        self.latched: Optional[bytes] = None
        self.dialing = False
        self.failures = 0
        self.retry_at = 0.0

    @property
    def is_awaited(self) -> bool:
        """True between the question and its answer."""
        return self.dialing or (self.wire is not None and self.header is None)

    @property
    def is_latched(self) -> bool:
        """True if its last message is for who comes later."""
        return (self.header or {}).get("latching") == "1"


class _Sink:
    """A listener."""

    def __init__(self, wire: Wire, answer: Fields, rate: Rate) -> None:
        self.wire, self.answer, self.rate = wire, answer, rate
        self.md5sum = ""  # that it got; empty before it has its header


class TopicFeed:
    """One topic."""

    def __init__(
        self,
        loop: Loop,
        dialers: Dialers,
        limited: program.LimitedLog,
        budget: Budget,
        topic: str,
        request_tick: Callable[[float], None],
        of_one: bool = False,
    ) -> None:
        """`request_tick(time)`: `tick` is to be called then.

        `of_one`: there is one publisher, and with its connection those of the listeners end, which ask again.
        """
        self._loop, self._dialers, self._limited, self.topic = loop, dialers, limited, topic
        self._budget, self._request_tick, self._of_one = budget, request_tick, of_one
        self._sources: Dict[Hashable, _Source] = {}
        self._sinks: Dict[Wire, _Sink] = {}
        self._own: Optional[Tuple[Fields, bytes]] = None  # the topic of this node itself: header and last message
        self.messages = self.size = self.dropped = 0

    @property
    def has_sinks(self) -> bool:
        """True while there is a listener."""
        return bool(self._sinks)

    @property
    def problem(self) -> str:
        """The reason why messages of a publisher stay away; empty without one."""
        return next((source.problem for source in self._sources.values() if source.problem), "")

    def aim(self, sources: Mapping[Hashable, Origin]) -> None:
        """Set the publishers, by keys that name their places: known ones stay."""
        for key in [key for key in self._sources if key not in sources]:
            self._close(self._sources.pop(key))
        for key, origin in sources.items():
            if key not in self._sources:
                self._sources[key] = _Source(origin)
        self._request_tick(0.0)

    def publish(self, header: Fields, message: bytes) -> None:
        """Publish a message of this node itself. The last one is for each who comes later."""
        self._own = (header, message)
        for sink in list(self._sinks.values()):
            if sink.md5sum:
                self._send(sink, message, monotonic())
            else:
                self._open(sink)

    def add(self, wire: Wire, answer: Fields, rate: Rate = NO_RATE) -> None:
        """Have messages go to a connection. `answer`: the fields of our header that are not the publisher's."""
        self._sinks[wire] = sink = _Sink(wire, answer, rate)
        self._open(sink)
        self._request_tick(0.0)

    def remove(self, wire: Wire) -> None:
        """A connection of `add` has ended."""
        sink = self._sinks.pop(wire, None)
        if sink is not None:
            self.dropped += wire.outbox.dropped + wire.throttle.dropped
            self._request_tick(0.0)

    def end(self) -> None:
        """Close all connections."""
        self.aim({})
        for wire in list(self._sinks):
            wire.end()

    def list_links(self) -> List[BusLink]:
        """List the connections. Called from any thread."""
        sinks, sources = list(self._sinks.values()), list(self._sources.values())
        wires = [(source.wire, source.origin) for source in sources if source.header is not None]
        links = [
            BusLink(wire.number, origin.uri, True, origin.question["topic"], wire.title, 0, 0)
            for wire, origin in wires
            if wire is not None
        ]
        for sink in sinks:
            box, peer = sink.wire.outbox, plain((sink.wire.header or {}).get("callerid", ""))
            links.append(
                BusLink(sink.wire.number, peer, False, sink.answer["topic"], sink.wire.title, box.sent, box.messages)
            )
        return links

    def count_dropped(self) -> int:
        """The number of messages that did not get to a listener: too many, too fast or too long."""
        now = sum(sink.wire.outbox.dropped + sink.wire.throttle.dropped for sink in self._sinks.values())
        return self.dropped + now + sum(of.wire.count_skipped() for of in self._sources.values() if of.wire is not None)

    def tick(self, now: float) -> None:
        """Connect and send all that is due."""
        for source in self._sources.values():
            if not self._sinks:
                self._close(source)
            elif source.wire is not None and source.header is None and now - source.wire.since > PATIENCE:
                source.wire.end("no header came")
            elif source.wire is not None and source.wire.is_stalled(now):
                source.wire.end("a message has begun and does not go on")
            elif source.wire is None and not source.dialing:
                if now >= source.retry_at:
                    self._dial(source)
                else:
                    self._request_tick(source.retry_at)
        for sink in list(self._sinks.values()):
            message = sink.wire.throttle.release(now)
            if message is not None:
                sink.wire.send(message)
            if sink.wire.throttle.due is not None:
                self._request_tick(sink.wire.throttle.due)

    # Publishers

    def _dial(self, source: _Source) -> None:
        if not self._dialers.held.have_room(source.origin.account.robot):
            self._fail(source, "too many connections to its robot are open")
            return
        source.dialing = True
        self._dialers.submit(
            source.origin.account.robot, source.origin.uri, source.origin.dial, partial(self._on_dial, source)
        )

    def _on_dial(self, source: _Source, connection: Any, problem: Optional[Exception]) -> None:
        source.dialing = False
        if connection is None:
            self._fail(source, str(problem))
        elif source not in self._sources.values() or not self._sinks:
            connection.close()
        else:
            try:
                source.wire = Wire(
                    self._loop,
                    connection,
                    source.origin.account,
                    partial(self._on_header, source),
                    partial(self._on_message, source),
                    partial(self._on_end, source),
                )
            except OSError as gone:
                connection.close()
                self._fail(source, str(gone))
                return
            self._dialers.held.add(source.origin.account.robot)
            source.wire.say(encode_header(source.origin.question))

    def _on_header(self, source: _Source, wire: Wire) -> None:
        header = wire.header or {}
        if "error" in header or not header.get("md5sum"):
            wire.end(f"it says {quote(header.get('error', '')) or 'no md5sum'}")
            return
        wire.header = header = {name: header[name] for name in _FIELDS if name in header}
        if any(len(header.get(name, "")) > MAX_NAME for name in _NAMES):
            wire.end("the type or the md5sum in its header is too long")
            return
        if self._take_header(source, wire, header):
            self._open_sinks()

    def _take_header(self, source: _Source, wire: Wire, header: Fields) -> bool:
        """Keep the header of a publisher, and how its frames are renamed; False, and its end, if that cannot be."""
        source.problem = ""
        try:
            if source.origin.change is not None:
                source.rewrite = make_rewrite(header, source.origin.change)
        except DefinitionError as problem:
            source.problem = f"its frames cannot be renamed: {quote(problem)}"
            wire.end(source.problem)
            return False
        if not wire.keep(weigh_fields(header) + (0 if source.rewrite is None else source.rewrite.size)):
            source.rewrite = None
            wire.end("the definitions of its robot take too much memory")
            return False
        source.header = header
        return True

    def _open_sinks(self) -> None:
        """Begin with each listener that a publisher can serve now."""
        known = {each["md5sum"] for each in self._list_headers()}
        for sink in list(self._sinks.values()):
            if sink.md5sum and sink.md5sum not in known:
                sink.wire.end("the publisher has another definition of the messages now")
            else:
                self._open(sink)

    def _on_message(self, source: _Source, wire: Wire, message: bytes) -> None:
        if source.header is None:
            return
        if source.rewrite is not None:
            try:
                message = source.rewrite(message)
            except FramesError as problem:
                self.dropped += 1
                text = f"a message of {quote(self.topic)} is left out: {quote(problem)}"
                self._limited.say("warning", f"frames {self.topic}", text)
                return
            if not message:
                return
        source.failures = 0
        self.messages += 1
        self.size += len(message)
        if source.is_latched:
            self._latch(source, message)
        now = monotonic()
        for sink in list(self._sinks.values()):
            if sink.md5sum == source.header["md5sum"]:
                self._send(sink, message, now)

    def _latch(self, source: _Source, message: Optional[bytes]) -> None:
        is_kept = self._budget.latch(source.origin.account.robot, source.latched, message)
        source.latched = message if is_kept else None
        if not is_kept:
            text = f"{self.topic}: the last message of a latched publisher is not kept for later listeners; there are too many such bytes"
            self._limited.say("warning", f"latched {self.topic}", text)

    def _on_end(self, source: _Source, wire: Wire, why: str) -> None:
        self._dialers.held.remove(source.origin.account.robot)
        had, source.header, source.rewrite = source.header, None, None
        if had is not None and monotonic() - wire.since > PATIENCE:
            source.failures = 0  # one that ends right after its header is asked ever later
        self.dropped += wire.count_skipped()
        self._latch(source, None)
        source.wire = None
        if why:
            self._fail(source, why)
        if had is not None and self._of_one:
            for sink in list(self._sinks.values()):
                sink.wire.end()

    def _fail(self, source: _Source, why: str) -> None:
        shortest, longest = AGAIN
        source.retry_at = monotonic() + min(longest, shortest * 2**source.failures)
        source.failures = min(source.failures + 1, 10)
        self._request_tick(source.retry_at)
        if source.failures > 2:
            self._limited.say(
                "warning", self.topic, f"{quote(self.topic)} cannot be had from its publisher: {plain(why)}"
            )

    def _close(self, source: _Source) -> None:
        if source.wire is not None:
            source.wire.end()
        source.failures, source.retry_at = 0, 0.0

    # Those who listen

    def _send(self, sink: _Sink, message: bytes, now: float) -> None:
        passed = sink.wire.throttle.take(message, now)
        if passed is not None:
            sink.wire.send(passed)
        if sink.wire.throttle.due is not None:
            self._request_tick(sink.wire.throttle.due)

    def _list_headers(self) -> List[Fields]:
        """List the headers of all who publish now. Two may have another definition, as two robots with other versions."""
        own = [] if self._own is None else [self._own[0]]
        return own + [source.header for source in self._sources.values() if source.header is not None]

    def _open(self, sink: _Sink) -> None:
        """Give a listener its header, as soon as there is one, and the latched messages."""
        header = None if sink.md5sum else self._choose_header(sink)
        if header is None:
            return
        same = [
            of for of in self._sources.values() if of.header is not None and of.header["md5sum"] == header["md5sum"]
        ]
        latching = self._own is not None or any(of.is_latched for of in same)
        names = ("type", "md5sum", "message_definition")
        fields = {name: header[name] for name in names if name in header}
        sink.wire.say(encode_header({**fields, **sink.answer, "latching": "1" if latching else "0"}))
        sink.md5sum = header["md5sum"]
        sink.wire.throttle = make_throttle(sink.rate, self.topic, header, self._budget)
        self._warn_of_unknown(find_unknown(sink.rate, self.topic, header))
        latched = [] if self._own is None else [self._own[1]]
        for message in (*latched, *(of.latched for of in same if of.latched is not None)):
            self._send(sink, message, monotonic())

    def _warn_of_unknown(self, kind: str) -> None:
        """Say that a rate has no effect on a topic of this type, if it is one."""
        if kind:
            text = f"{quote(self.topic)} crosses without its rate: it is not known that a message of {quote(kind)} replaces the one before"
            self._limited.say(
                "warning", f"rate {self.topic}", f"{text}; if it does, add 'whole: [{plain(kind)}]' to 'rate'"
            )

    def _choose_header(self, sink: _Sink) -> Optional[Fields]:
        """Return the header of a publisher with the definition that a listener asks for; None without one. A listener that none can serve is sent away."""
        headers = self._list_headers()
        asked = (sink.wire.header or {}).get("md5sum", "*")
        found = next((each for each in headers if asked in ("*", each["md5sum"])), None)
        # A publisher whose definition is not known yet may have this one.
        if found is None and headers and not any(source.is_awaited for source in self._sources.values()):
            text = f"md5sum {quote(asked)} is asked for, and the publisher has {quote(headers[0]['md5sum'])}"
            sink.wire.say(encode_header({"error": text}))
            sink.wire.end("it asks for another definition of the messages")
        return found


MakeFeed = Callable[[str, bool], TopicFeed]  # of a topic; whether it has one publisher
