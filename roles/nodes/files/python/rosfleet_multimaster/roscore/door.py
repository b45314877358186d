# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The door of the roscore: connections, requests and answers of any caller, each with a bound and all of them together.

It answers as xmlrpc.server does. A call that exceeds a bound is answered as one that failed: [-1, a sentence, 0].
"""

import contextlib
import gzip
import logging
import socket
import threading
import xmlrpc.client
from collections import Counter
from typing import Any, Callable, Dict, Iterator, List, NamedTuple, Optional, Tuple

from ..edge.clock import monotonic
from ..edge.core.shares import Shares
from ..edge.process.room import NoRoom, Room
from ..edge.process.throttle import Throttle
from ..edge.rpc_client import cut
from ..edge.rpc_server import BoundedHandler
from ..protocol.members import NOBODIES
from ..protocol.plain_text import LINE, plain
from ..protocol.xml_rpc import Document, DocumentTooLarge, unpack
from .core.bounds import BOUNDS, BoundRefusal, refuse, weigh

_log = logging.getLogger("rosfleet.door")

PATIENCE = 30.0  # seconds for a request from its head to its end, and for an answer to be taken
ROOM = 10.0  # seconds that a large request or answer waits for memory
_PIECE = 1 << 16  # bytes
_SMALL = 1 << 16  # bytes of a request or an answer that is not counted: there are at most as many as connections
_DISCARD = 1 << 28  # bytes of a too long request that are read, so that its sender comes to the answer
_COMPRESS = 1400  # bytes of an answer
_ANSWER = 2  # times as much memory as its values count
_READ, _PACKED = 6, 20  # times as much memory as a request has bytes: one of only empty values costs so much
#: Of the throttle, in seconds of a processor: a second of another robot, and of all others together; ahead; and to wait.
_SHARE, _TOGETHER, _AHEAD = 0.25, 0.5, 5.0
_PATHS = ("/", "/RPC2", "/pydoc.css")  # the paths of xmlrpc.server

Socket = socket.socket

OWN = "this computer"  # the robot of its own programs


class Caller(NamedTuple):
    """The caller of this thread."""

    address: str = ""
    here: str = ""  # the own address that it called
    has_left: Callable[[], bool] = lambda: False
    pause: Callable[[], None] = lambda: None  # waits if it has taken more than its share. Raises BoundRefusal
    ends: Tuple[Tuple[str, int], Tuple[str, int]] = (("", 0), ("", 0))  # its connection: there, and here
    other: Optional[str] = None  # the other robot that it is of; None for a computer of this one

    @property
    def is_own(self) -> bool:
        """True if it is on this computer."""
        return self.address.startswith("127.") or self.address in ("::1", self.here)


class _Connection:
    """An open connection."""

    def __init__(self, robot: str) -> None:
        self.robot, self.busy, self.since = robot, False, monotonic()
        self.own = robot == OWN


class Connections:
    """The open connections. If they are too many, the one that was idle longest ends: of another computer first.

    Another robot has a quarter of the places, and all others together have three quarters. If all of these are busy, the
    robot that has most loses its oldest one to a robot that has less than half as many.
    """

    def __init__(self, most: int) -> None:
        self._most = most
        self._open: Dict[Socket, _Connection] = {}

    def add(self, connection: Socket, robot: str) -> bool:
        """Add one of a robot. False if all places are taken by busy ones."""
        places = [(self._most, lambda _state: True)]
        if robot != OWN:
            places = [
                (self._most // 4, lambda state: state.robot == robot),
                (self._most // 4 * 3, lambda state: not state.own),
                *places,
            ]
        for most, counts in places:
            if len(self._open) >= most and not self._make_room(robot, most, counts):
                return False
        self._open[connection] = _Connection(robot)
        return True

    def _make_room(self, robot: str, most: int, counts: Callable[[_Connection], bool]) -> bool:
        found = [(state.own, state.since, other) for other, state in list(self._open.items()) if counts(state)]
        if len(found) < most:
            return True
        ending = [row for row in found if not self._open[row[2]].busy] or self._find_excess(robot)
        if not ending:
            return False
        longest = min(ending, key=lambda row: row[:2])[2]
        self._open.pop(longest, None)
        cut(longest)
        return True

    def _find_excess(self, robot: str) -> List[Tuple[bool, float, Socket]]:
        """The connections of the other robot that has most, if it has more than twice as many as this one."""
        held = Counter(state.robot for state in list(self._open.values()) if not state.own)
        most, count = max(held.items(), key=lambda item: item[1], default=("", 0))
        if robot == OWN or count <= 2 * held[robot]:
            return []
        return [(False, state.since, other) for other, state in list(self._open.items()) if state.robot == most]

    def mark(self, connection: Socket, busy: bool) -> None:
        """Note that a call begins or ends."""
        state = self._open.get(connection)
        if state is not None:
            state.busy, state.since = busy, monotonic()

    def remove(self, connection: Socket) -> None:
        """Remove one that has ended."""
        self._open.pop(connection, None)


class Door:
    """The common data of the handlers of all connections."""

    def __init__(
        self,
        dispatch: Callable[[str, Tuple[Any, ...]], Any],
        on_refusal: Callable[[BoundRefusal], None],
        calls: threading.local,
        robot_at: Callable[[str], str] = str,
    ) -> None:
        """`on_refusal(why)` is called for each request that exceeds a bound; `calls.caller` is set before each call.

        `robot_at(address)`: which robot has another computer.
        """
        self.dispatch, self.on_refusal, self.calls, self._robot_at = dispatch, on_refusal, calls, robot_at
        most = BOUNDS["under way"].most
        self.room = Room(Shares(most, most // 8 * 3, [], OWN, most // 2), _SMALL, ROOM)
        self.connections = Connections(BOUNDS["connections"].most)
        self.throttle = Throttle(_SHARE, _TOGETHER, _AHEAD, PATIENCE)

    def find_robot(self, caller: Caller) -> str:
        """Return the robot that a caller is of; OWN for this computer."""
        return OWN if caller.is_own else self._robot_at(caller.address)

    def find_other(self, caller: Caller) -> Optional[str]:
        """Return the other robot that a caller is of; None for each computer of this one."""
        robot = self.find_robot(caller)
        is_here = robot == OWN or (robot not in NOBODIES and robot == self._robot_at(caller.here))
        return None if is_here else robot


class Handler(BoundedHandler):
    """A connection."""

    door: Door
    head = BOUNDS["head"].most

    def __init__(self, request: socket.socket, client_address: Any, server: Any) -> None:
        there, here = client_address[:2], request.getsockname()[:2]
        self._caller = Caller(there[0], here[0], self._has_left, self._pause, (there, here))
        self._caller = self._caller._replace(other=self.door.find_other(self._caller))
        self._payer = self.door.find_robot(self._caller)
        self.throttle, self.robot = self.door.throttle, None if self._payer == OWN else self._payer
        self._held = contextlib.ExitStack()  # the memory of this call
        self._until = 0.0  # the body of a request is to be here by then
        super().__init__(request, client_address, server)  # serves the connection until its end

    def handle_one_request(self) -> None:
        """A request."""
        try:
            super().handle_one_request()
        finally:
            self.door.connections.mark(self.connection, False)

    def log_message(self, *_arguments: Any) -> None:
        """Log no requests."""

    def do_POST(self) -> None:  # the name is the standard library's
        """A call."""
        self.door.connections.mark(self.connection, True)
        self.door.calls.caller = self._caller
        if self.path not in _PATHS:
            self.close_connection = True
            self.send_error(404)
            return
        try:
            with contextlib.ExitStack() as self._held:
                value = self._run_call()
                self._reserve(value)
                self._send(_to_xml(value))
        except BoundRefusal as problem:
            self.door.on_refusal(problem)
            self._send(_to_xml((-1, plain(problem, LINE), 0)))
        finally:
            self.connection.settimeout(None)

    def _take(self, size: int) -> None:
        """Take memory until the call has its answer: its values stay for so long. Raises BoundRefusal."""
        try:
            self._held.enter_context(self.door.room.take(self._payer, size))
        except NoRoom:
            raise refuse("under way", "the requests of now, with those of others,") from None

    # The request

    def _run_call(self) -> Any:
        """Read a call and run it: its result, or a Fault."""
        try:
            name, arguments = self._read_request()
            return self.door.dispatch(name, arguments)
        except (BoundRefusal, OSError):
            raise
        except xmlrpc.client.Fault as fault:
            return fault
        except Exception as problem:  # expat, xmlrpc, zlib and rosmaster have a dozen
            return _to_fault(problem)

    def _read_request(self) -> Tuple[str, Tuple[Any, ...]]:
        """The method and its arguments. Raises BoundRefusal, OSError, or an error of expat or xmlrpc."""
        length, encoding = self.headers.get("Content-Length", ""), self.headers.get("Content-Encoding", "identity")
        packed = {"identity": False, "gzip": True}.get(encoding.lower())
        if not length.isdecimal() or len(length) > 15 or packed is None:
            self.close_connection = True  # the next request may begin anywhere
            raise ValueError("a request without its length, or in an encoding that is not known")
        left, most = int(length), BOUNDS["request"].most
        self._until = monotonic() + PATIENCE
        if left > most:
            self.close_connection = True
            _drain(self._read_body(min(left, _DISCARD)))
            raise refuse("request", f"a request of {left:,} bytes")
        self._take(min((_PACKED if packed else _READ) * left, 2 * most))
        body = self._read_body(left)
        document = Document(most, BOUNDS["values"].most, BOUNDS["text"].most, plain_types=False)
        try:
            for piece in unpack(body, most) if packed else body:
                document.feed(piece)
            arguments, name = document.close()
        except Exception as problem:
            _drain(body)
            if isinstance(problem, DocumentTooLarge):
                raise BoundRefusal(f"a request is more than the roscore takes: {problem}", "request") from None
            raise
        self.connection.settimeout(None)
        if not isinstance(name, str):
            raise ValueError("no method is named")
        return name, arguments

    def _read_body(self, left: int) -> Iterator[bytes]:
        while left > 0:
            self.connection.settimeout(max(0.01, self._until - monotonic()))
            piece = self.rfile.read1(min(left, _PIECE))
            if not piece or monotonic() > self._until:
                self.close_connection = True
                raise ConnectionAbortedError("a request that does not end")
            left -= len(piece)
            yield piece

    # The answer

    def _reserve(self, value: Any) -> None:
        """Take the memory for an answer. Raises BoundRefusal."""
        size = 0 if isinstance(value, xmlrpc.client.Fault) else weigh(value)
        if size > BOUNDS["answer"].most:
            raise refuse("answer", "the answer")
        self._take(_ANSWER * size)

    def _send(self, body: bytes) -> None:
        packs = len(body) > _COMPRESS and "gzip" in self.headers.get("Accept-Encoding", "")
        if packs:
            body = gzip.compress(body, 1)
        self.send_response(200)
        self.send_header("Content-type", "text/xml")
        if packs:
            self.send_header("Content-Encoding", "gzip")
        self.send_header("Content-length", str(len(body)))
        self.end_headers()
        until = monotonic() + PATIENCE
        self.wfile.flush()
        view = memoryview(body)
        while view:
            self.connection.settimeout(max(0.01, until - monotonic()))
            view = view[self.connection.send(view[:_PIECE]) :]
            if view and monotonic() > until:
                raise ConnectionAbortedError("an answer that is not taken")

    def _pause(self) -> None:
        self.count_effort()
        if self.robot is not None and not self.throttle.wait(self.robot):
            raise refuse("effort", "the requests of this computer")

    def _has_left(self) -> bool:
        try:
            return not self.connection.recv(1, socket.MSG_PEEK | socket.MSG_DONTWAIT)
        except BlockingIOError:
            return False
        except OSError:
            return True


def _drain(body: Iterator[bytes]) -> None:
    for _piece in body:
        pass


def _to_fault(problem: Exception) -> xmlrpc.client.Fault:
    """Make the fault of a call that failed, as the standard library does."""
    return xmlrpc.client.Fault(1, plain(f"{type(problem)}:{problem}", LINE))


def _to_xml(value: Any) -> bytes:
    """Write an answer or a fault in XML."""
    fault = isinstance(value, xmlrpc.client.Fault)
    try:
        text = xmlrpc.client.dumps(value if fault else (value,), methodresponse=not fault)
    except Exception as problem:  # a value that XML-RPC cannot carry
        text = xmlrpc.client.dumps(_to_fault(problem))
    return text.encode("utf-8", "xmlcharrefreplace")


def multicall(
    dispatch: Callable[[str, Tuple[Any, ...]], Any], calls: Any, pause: Callable[[], None] = lambda: None
) -> List[Any]:
    """The results of several calls, each in a list of its own, or a mapping with its fault. Raises BoundRefusal or ValueError.

    `pause()` is called before each of them.
    """
    if not isinstance(calls, list) or not all(isinstance(call, dict) for call in calls):
        raise ValueError("system.multicall takes a list of mappings")
    if len(calls) > BOUNDS["calls"].most:
        raise refuse("calls", f"a system.multicall of {len(calls):,} calls")
    results: List[Any] = []
    size = 0
    for call in calls:
        pause()
        try:
            name, arguments = call["methodName"], call["params"]
            if name == "system.multicall" or not isinstance(name, str) or not isinstance(arguments, list):
                raise ValueError("a system.multicall in another one, or no call")
            results.append([dispatch(name, tuple(arguments))])
        except Exception as problem:
            fault = problem if isinstance(problem, xmlrpc.client.Fault) else _to_fault(problem)
            results.append({"faultCode": fault.faultCode, "faultString": fault.faultString})
        size += weigh(results[-1])
        if size > BOUNDS["answer"].most:
            raise refuse("answer", "the answer")
    return results
