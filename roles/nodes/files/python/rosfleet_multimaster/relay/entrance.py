# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The entrance of a relay: connections of listeners, clients and other relays, counted by robot, each given to its feed or call."""

import contextlib
from functools import partial
from typing import Any, Callable, Dict, Optional, Tuple

from ..edge.clock import monotonic
from ..edge.core.shares import Shares
from ..edge.loop import Loop
from ..edge.process import program
from ..edge.rpc_server import Callers
from ..protocol.filters import MAX_NAME
from ..protocol.plain_text import quote
from ..protocol.tcpros.header import encode_header
from .account import Accounts
from .calls import Call, Calls
from .core.rates import NO_RATE
from .dial import Dialers, listen
from .feed import Fields, TopicFeed
from .given import GivenSide
from .parties import NAME, NODE, ROBOT, Parties
from .taken import TakenSide
from .wire import PATIENCE, Wire

MOST_WIRES, MOST_NEW = 1000, 200  # incoming connections, and those without a header
MOST_WIRES_OF_ONE, MOST_NEW_OF_ONE = 400, 50  # of one other robot
ACCEPTS = 16  # connections that are taken in one turn of the loop
AGAIN = 0.1  # seconds until connections are taken again if there were no more files
MOST_FIRST = 1 << 15  # bytes of a call that wait for its provider: its header, and the bytes that came with it


class Entrance:
    """The incoming connections."""

    def __init__(
        self,
        loop: Loop,
        parties: Parties,
        rules: Callers,
        accounts: Accounts,
        limited: program.LimitedLog,
        dialers: Dialers,
        sides: Tuple[GivenSide, TakenSide, Dict[str, TopicFeed]],
        on_change: Callable[[], None],
        request_look: Callable[[float], None],
    ) -> None:
        """`sides`: the two, and the own topics of this node. `on_change()`: the listeners have changed. `request_look(time)`: call `tick` then."""
        self._loop, self._parties, self._rules, self._accounts, self._limited = loop, parties, rules, accounts, limited
        self._dialers, (self._given, self._taken, self._own) = dialers, sides
        self._on_change, self._request_look = on_change, request_look
        self._listener = listen()
        self._listens_at = 0.0  # when it is watched again; 0: it is
        self._wires: Dict[Wire, Optional[TopicFeed]] = {}
        self._calls = Calls(loop, [f"{way} {robot}" for robot in parties.all for way in ("of", "to")])
        self._open = Shares(MOST_WIRES, MOST_WIRES_OF_ONE, parties.all, parties.robot)
        self._new = Shares(MOST_NEW, MOST_NEW_OF_ONE, parties.all, parties.robot)

    @property
    def port(self) -> int:
        """The port that takes connections."""
        return int(self._listener.getsockname()[1])

    def open(self) -> None:
        """Take connections from now on."""
        self._loop.watch(self._listener, self._accept)

    def tick(self, now: float) -> None:
        """End connections that take too long."""
        self._calls.tick(now)
        for wire in [wire for wire in self._wires if wire.header is None and now - wire.since > PATIENCE]:
            wire.end()

    def reopen(self, now: float) -> None:
        """Take connections again, if there were no more files a while ago."""
        if self._listens_at and now >= self._listens_at:
            self._listens_at = 0.0
            self.open()

    def report_malformed(self, host: str, why: str) -> None:
        """Log a request or a connection that is refused."""
        self._limited.say("warning", f"malformed {host}", f"a request of {host} is refused: {quote(why)}")

    def _accept(self) -> None:
        """Take some of those who wait: many of one robot are before another's in the kernel's queue."""
        for _number in range(ACCEPTS):
            if not self._accept_one():
                return

    def _accept_one(self) -> bool:
        """Take a connection; False if no connection waits."""
        try:
            connection, (address, _port) = self._listener.accept()
        except BlockingIOError:
            return False
        except OSError as problem:  # no more files: the connection stays, and would wake the loop all the time
            self._limited.say("warning", "accept", f"no connection can be taken: {problem.strerror}")
            self._loop.forget(self._listener)
            self._listens_at = monotonic() + AGAIN
            return False
        robot = self._parties.find_robot(address)
        refusal = self._rules.find_refusal(address, connection.getsockname()[0])
        if not refusal and not (self._open.have_room(robot) and self._new.have_room(robot)):
            refusal = "too many connections of its robot at once"
        if refusal:
            connection.close()
            self.report_malformed(address, refusal)
        else:
            self._begin(connection, robot)
        return True

    def _begin(self, connection: Any, robot: str) -> None:
        try:
            wire = Wire(self._loop, connection, self._accounts.find(robot), self._greet, None, self._on_gone)
        except OSError:
            connection.close()
            return
        self._wires[wire] = None
        self._open.add(robot)
        self._new.add(robot)
        self._request_look(monotonic() + PATIENCE)

    def _greet(self, wire: Wire) -> None:
        """Give a listener to its feed, and a client to its service."""
        header = wire.header or {}
        self._new.remove(wire.robot)
        if "service" in header:
            self._pass_call(wire, header)
            return
        topic, robot = header.get("topic", ""), header.get(ROBOT)
        feed: Optional[TopicFeed]
        rate = NO_RATE
        if robot is not None:
            feed, rate = self._given.find_feed(wire, robot, topic, header.get(NODE, ""))
        elif topic in self._own:
            feed = self._own[topic]
        else:
            feed = None if wire.address in self._parties.hosts.foreign else self._taken.feeds.get(topic)
        if feed is None:
            _refuse(wire, f"{quote(topic)} is not published here")
            return
        self._wires[wire] = feed
        wire.header = {name: header[name][:MAX_NAME] for name in ("callerid", "md5sum") if name in header}
        feed.add(wire, {"callerid": NAME, "topic": topic}, rate)
        self._on_change()

    def _pass_call(self, wire: Wire, header: Fields) -> None:
        """Connect a client with the provider of its service, or with the relay that has it."""
        service, robot = header["service"], header.get(ROBOT)
        # each robot has its own relay
        own = None if wire.address in self._parties.hosts.foreign else self._taken.providers.get(service)
        found = own if robot is None else self._given.find_provider(wire, robot, service)
        if found is None:
            _refuse(wire, f"{quote(service)} is not provided here")
            return
        fields = {**header, "callerid": NAME, "service": found.name}
        fields.pop(ROBOT, None)
        first = encode_header({**fields, ROBOT: self._parties.robot} if robot is None else fields) + wire.rest
        account, party = self._accounts.find(found.robot), f"to {found.robot}"
        if wire.robot != self._parties.robot:
            account, party = wire.account, f"of {wire.robot}"
        call = self._calls.begin(account, party, wire.connection, first) if len(first) <= MOST_FIRST else None
        if call is None:
            _refuse(wire, "too many calls at once, or too long a header")
            return
        self._forget(wire)
        wire.detach()
        self._dialers.submit(found.robot, found.place, found.dial, partial(self._on_dialed, call, service))

    def _on_dialed(self, call: Call, service: str, provider: Any, problem: Optional[Exception]) -> None:
        if provider is not None:
            call.start(provider)
            return
        text = f"{quote(service)} cannot be reached: {quote(problem)}"
        self._limited.say("warning", f"service {call.party}", text)
        with contextlib.suppress(OSError):
            call.client.send(encode_header({"error": text}))
        call.end()

    def _on_gone(self, wire: Wire, why: str) -> None:
        if wire.header is None:
            self._new.remove(wire.robot)
        feed = self._forget(wire)
        if feed is not None:
            feed.remove(wire)
            self._taken.forget_idle(feed)
            self._on_change()

    def _forget(self, wire: Wire) -> Optional[TopicFeed]:
        """Count a connection no more. Return the feed that it listens to."""
        self._open.remove(wire.robot)
        return self._wires.pop(wire, None)


def _refuse(wire: Wire, why: str) -> None:
    wire.say(encode_header({"error": why}))
    wire.end()
