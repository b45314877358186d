# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""A connection of TCPROS: a header each way, then messages. It never blocks."""

import itertools
import socket
from typing import Callable, Dict, Optional

from ..edge.clock import monotonic, processor_time
from ..edge.loop import Loop
from ..protocol.tcpros.header import HeaderError, decode_header
from ..protocol.tcpros.messages import MessageReader
from .account import Account
from .core.effort import SLICE
from .core.outbox import Outbox
from .core.rates import AnyThrottle, RateLimit

MAX_HEADER = 1 << 18  # bytes; the definition of the messages is in it
MAX_MESSAGE = 1 << 24  # bytes of one message; a larger one is left out
PATIENCE = 10.0  # seconds until the header has to be there
# Bytes at once, so that no connection holds the others up: of messages; and before it is known that these come
_READ, _READ_FIRST = 1 << 18, 1 << 14
#: bytes that the kernel keeps of a connection of which only the newest message counts
_SMALL_BUFFER = 1 << 16
SILENCE = 10.0  # seconds without an acknowledgement
#: the same if nothing is sent: the kernel asks after 4 s, and ends the connection after three questions
_ALIVE = {socket.TCP_KEEPIDLE: 4, socket.TCP_KEEPINTVL: 2, socket.TCP_KEEPCNT: 3}


_numbers = itertools.count(1)


def keep_alive(connection: socket.socket) -> None:
    """Have the kernel end a connection whose other end has gone without a word. Raises OSError."""
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    for option, value in _ALIVE.items():
        connection.setsockopt(socket.IPPROTO_TCP, option, value)


class Wire:
    """One connection. Its messages and its end are reported by callbacks in the loop."""

    def __init__(
        self,
        loop: Loop,
        connection: socket.socket,
        account: Account,
        on_header: Callable[["Wire"], None],
        on_message: Optional[Callable[["Wire", bytes], None]],
        on_end: Callable[["Wire", str], None],
    ) -> None:
        """`account`: of the robot at the other end. `on_message`: None for a subscriber here, which sends only its header."""
        address, port = connection.getpeername()[:2]  # of the other end. Raises OSError if it has gone.
        self.address, self.number = str(address), next(_numbers)
        #: as rospy says it in getBusInfo
        self.title = f"TCPROS connection on port {connection.getsockname()[1]} to [{address}:{port} on socket {connection.fileno()}]"
        self.header: Optional[Dict[str, str]] = None  # of the other end
        self.account, self._budget = account, account.budget
        self.outbox, self.ended = Outbox(self._budget), False
        self.throttle: AnyThrottle = RateLimit(0.0)  # messages that wait for the rate of sending
        self.since = self.progress = self._came = monotonic()
        self._loop, self.connection = loop, connection
        self._on_header, self._on_message, self._on_end = on_header, on_message, on_end
        self._reader = MessageReader(MAX_HEADER)
        self._kept = 0  # bytes that stay until its end
        self._counted = 0  # bytes of the message that is being read
        self._watched = False  # for being writable
        self._waiting = False  # for its turn, or for the share of its robot; then nothing is read of it
        connection.setblocking(False)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        keep_alive(connection)
        loop.watch(connection, self._on_ready)
        self._budget.payers.add(self)

    @property
    def robot(self) -> str:
        """The robot at the other end."""
        return self.account.robot

    def keep(self, size: int) -> bool:
        """Count bytes that are kept for it until its end; False if its robot has too many."""
        if not self._budget.keep(self.robot, size):
            return False
        self._kept += size
        return True

    @property
    def size(self) -> int:
        """Bytes that it can do without: of messages that wait, and of the one that is being read."""
        return self.outbox.size + self.throttle.size + self._counted

    @property
    def is_sending(self) -> bool:
        """True if it also holds messages that are being sent."""
        return self.outbox.is_sending

    @property
    def is_stuck(self) -> bool:
        """True if bytes wait, and for long no byte has left."""
        return self.outbox.is_sending and monotonic() - self.progress > SILENCE

    def is_stalled(self, now: float) -> bool:
        """True if a message is there in part, and nothing more of it has come for long."""
        return self._counted > 0 and now - self._came > SILENCE

    def shrink(self) -> None:
        """Hold less, since all connections hold too much."""
        if len(self.outbox):
            self.outbox.drop_all()
        elif self.throttle.size:
            self.throttle.drop_all()
        else:
            self._reader.give_up()
            self._budget.change(-self._counted)
            self._counted = 0

    def count_skipped(self) -> int:
        """The number of refused messages: too long, or too much at once."""
        return self._reader.skipped

    def limit_silence(self) -> None:
        """End the connection if sent bytes are not acknowledged: the link is cut. The other end always reads."""
        self.connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, int(1000 * SILENCE))

    def keep_newest(self) -> None:
        """Let one message wait, and have the kernel keep few of the sent bytes: a slow link gets new messages."""
        self.outbox.close()
        self.outbox = Outbox(self._budget, newest=True)
        self.connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SMALL_BUFFER)

    def say(self, header: bytes) -> None:
        """Send a header."""
        if self.ended:
            return
        self.outbox.say(header)
        self._flush()

    def send(self, message: bytes) -> None:
        """Send a message, its length in front, as soon as the other end takes it."""
        if self.ended:
            return
        self.outbox.add(message)
        if not self._watched:
            self._flush()

    def end(self, why: str = "") -> None:
        """Close the connection."""
        if self.ended:
            return
        self._let_go()
        self.connection.close()
        self._on_end(self, why)

    @property
    def rest(self) -> bytes:
        """The bytes that came after its header."""
        return self._reader.rest()

    def detach(self) -> None:
        """Leave the connection to another object."""
        self._let_go()

    def _let_go(self) -> None:
        self.ended = True
        self._budget.payers.discard(self)
        self._budget.change(-self._counted)
        self._budget.keep(self.robot, -self._kept)
        self._counted = self._kept = 0
        self.outbox.close()
        self.throttle.close()
        if not self._waiting:
            self._loop.forget(self.connection)

    def _on_ready(self) -> None:
        is_heard = self.header is None or self._on_message is not None  # bytes cost the robot that has sent them to us
        if is_heard and not self.account.may_go_on:
            self._wait()
            return
        self._read()
        if not self.ended and self._watched:
            self._flush()

    def _read(self) -> None:
        began = processor_time()
        try:
            data = self.connection.recv(_READ_FIRST if self.header is None else _READ)
        except BlockingIOError:
            return
        except OSError as problem:
            self.end(str(problem))
            return
        if not data:
            self.end("it was closed")
            return
        if self.header is not None and self._on_message is None:
            self.end("it sends more than its header")
            return
        self._came = monotonic()
        self._reader.feed(data)
        self._take(began)

    def _take(self, began: float) -> None:
        """Hand on the messages that are here, as many as it may now. `began`: the time of the processor before."""
        is_due = True
        while is_due and not self.ended:
            message = self._reader.take()
            if message is None:
                break
            if self.header is None:
                self._take_header(message)
            elif self._on_message is not None:
                self._on_message(self, message)
            is_due = self._on_message is None or processor_time() - began < SLICE
        if self.header is None and self._reader.skipped:
            self.end("its header is too long")
        self.account.spend(processor_time() - began)
        if not self.ended:
            self._count_read()
            if not is_due:
                self._wait()

    def _wait(self) -> None:
        """Leave incoming bytes in the kernel until it is our turn."""
        self._waiting = True
        self._loop.forget(self.connection)
        self.account.queue(self._go_on)

    def _go_on(self) -> None:
        if self.ended:
            return
        self._waiting = False
        self._loop.watch(self.connection, self._on_ready)
        self._loop.watch_output(self.connection, self._watched)
        self._came = monotonic()
        self._take(processor_time())

    def _count_read(self) -> None:
        more, self._counted = self._reader.size - self._counted, self._reader.size
        self._budget.change(more)

    def _take_header(self, message: bytes) -> None:
        try:
            self.header = decode_header(message)
        except HeaderError as problem:
            self.end(f"no header: {problem}")
            return
        self._reader.most = 0 if self._on_message is None else MAX_MESSAGE
        self._on_header(self)

    def _flush(self) -> None:
        if not self.outbox.is_sending:
            self.progress = monotonic()
        try:
            while not self.ended:
                due = self.outbox.find_due()
                if not due:
                    break
                self.outbox.count_sent(self.connection.send(due))
                self.progress = monotonic()
        except BlockingIOError:
            self._watch(True)
            return
        except OSError as problem:
            self.end(str(problem))
            return
        if not self.ended:
            self._watch(False)

    def _watch(self, wanted: bool) -> None:
        if wanted != self._watched:
            self._watched = wanted
            if self._waiting:
                return
            self._loop.watch_output(self.connection, wanted)
