# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The XML-RPC server that other programs call."""

import contextlib
import gzip
import inspect
import logging
import socket
import socketserver
import threading
import xmlrpc.client
from http.server import BaseHTTPRequestHandler
from typing import Any, Callable, Collection, Dict, Iterable, Mapping, NamedTuple, Optional, Tuple, Union

from ..protocol.members import ALLOW, ALLOWED, Members
from ..protocol.plain_text import LINE, plain
from ..protocol.xml_rpc import MAX_REQUEST, loads, unpack
from .clock import monotonic, processor_time, sleep
from .core.shares import Shares
from .loop import Count
from .process import program
from .process.room import NoRoom, Room
from .process.systemd import notify
from .process.throttle import Throttle
from .rpc_client import BoundedLines, cut

_log = logging.getLogger("rosfleet.rpc_server")

# Connections at once, and those of one robot, by all of its addresses: a part is kept for each robot that is known.
_MAX_CONNECTIONS, _MAX_OF_ONE = 64, 16
_FOR_EACH = 2  # and so many more for each robot that is known
_MAX_SECONDS = 15.0
_KEPT, _KEPT_OF_ONE = 256, 4  # connections with a long poll; they do not count above
_KEPT_SECONDS = 60.0 + _MAX_SECONDS  # for a question on one of these
_COMPRESS = 700  # bytes
# Bytes of memory of large requests and answers at once, and those of one robot; those smaller than the third are not counted.
_MEMORY, _MEMORY_OF_ONE, _SMALL = 64 << 20, 8 << 20, 1 << 15
_ROOM = 5.0  # seconds that a large one waits for memory
_READ, _UNPACKED = 6, 4 << 20  # times as much memory as a request has bytes; and bytes of memory of any that is packed
# Of the throttle, in seconds of a processor: a second of one robot, and of all together; ahead; and seconds to wait.
_SHARE, _TOGETHER, _AHEAD, _PATIENCE = 0.2, 0.5, 1.0, 5.0


class RefusedCall(Exception):
    """A method refuses a call. The caller gets the text as a fault."""


class PerCaller:
    """A method whose answer depends on the caller: its first argument is the caller's address."""

    def __init__(self, method: Callable[..., Any]) -> None:
        self.method = method


class LongPoll(PerCaller):
    """A method that waits for news, if its second argument is true. Then the connection is kept for the next call."""


Method = Union[Callable[..., Any], PerCaller]


class PackedAnswer:
    """A large answer in packed form, which is all that a connection holds of it. It is made once for many callers."""

    def __init__(self, value: Any) -> None:
        body = _encode(value)
        self.size, self.packed = len(body), gzip.compress(body, 1)


class Callers(NamedTuple):
    """The rules for callers. They are asked in the thread that takes connections."""

    find_refusal: Callable[[str, str], str] = lambda _caller, _here: ""  # (its address, ours) -> why not; "" if it may
    robot: Callable[[str], str] = str  # who is at an address: all computers of a robot are one, and all strangers
    robots: Collection[str] = ()  # for each of which a part is kept
    own: str = ""  # the one of this computer


EVERYBODY = Callers()
HERE = "this computer"  # the robot of its own programs


class _CallerConnection(NamedTuple):
    robot: str
    since: float  # when it was made, or the last question on it came
    kept: bool  # for a long poll


class RpcServer(socketserver.ThreadingMixIn, socketserver.TCPServer):
    """An XML-RPC server with bounds: connections, size of a request, and time of a connection."""

    daemon_threads = True
    block_on_close = False
    allow_reuse_address = True
    request_queue_size = 128

    def __init__(
        self,
        address: str,
        port: int,
        methods: Mapping[str, Method],
        malformed: Callable[[str, str], None],
        callers: Callers = EVERYBODY,
    ) -> None:
        """`malformed(host, why)` is called for each malformed request. Raises OSError if the port is taken."""
        self.methods: Dict[str, Method] = dict(methods)
        self.methods["system.listMethods"] = lambda: sorted(self.methods)
        self.methods["system.methodHelp"] = lambda name: _help(self.methods.get(name))
        self.methods["system.methodSignature"] = lambda name: "signatures not supported"
        self.malformed, self._callers = malformed, callers
        self.sent = Count()  # bytes of answers
        self.throttle = Throttle(_SHARE, _TOGETHER, _AHEAD, _PATIENCE)
        self._open: Dict[socket.socket, _CallerConnection] = {}
        robots, own = callers.robots, callers.own
        more = _FOR_EACH * len(robots)
        self._shares = {  # by whether they are kept for a long poll
            False: Shares(_MAX_CONNECTIONS + more, _MAX_OF_ONE, robots, own),
            True: Shares(_KEPT + more, _KEPT_OF_ONE, robots, own),
        }
        self._counting = threading.Lock()
        self.room = Room(Shares(_MEMORY, _MEMORY_OF_ONE, robots, own), _SMALL, _ROOM)
        super().__init__((address, port), _Handler)
        threading.Thread(target=self.serve_forever, name="xml-rpc", kwargs={"poll_interval": 1.0}, daemon=True).start()

    def verify_request(self, request: Any, client_address: Any) -> bool:
        """Refuse a connection that is not allowed, or is one too many."""
        address = client_address[0]
        refusal = self._callers.find_refusal(address, request.getsockname()[0])
        if not refusal and not self._begin(request, self.robot_at(address)):
            refusal = "too many connections of its robot at once"
        if refusal:
            self.malformed(address, refusal)
            return False
        return True

    def _begin(self, request: socket.socket, robot: str, kept: bool = False) -> bool:
        """Count a connection of a robot, in the place of the same one that was not kept. False if there is no room."""
        with self._counting:
            if not self._shares[kept].have_room(robot):
                return False
            self._end(request)
            self._shares[kept].add(robot)
            self._open[request] = _CallerConnection(robot, monotonic(), kept)
            return True

    def _end(self, request: socket.socket) -> None:
        """Count a connection no more. The lock is held."""
        before = self._open.pop(request, None)
        if before is not None:
            self._shares[before.kept].remove(before.robot)

    def keep(self, request: socket.socket) -> bool:
        """Keep a connection for a long poll. False if there are too many."""
        before = self._open[request]
        if before.kept:
            self._open[request] = before._replace(since=monotonic())
            return True
        return self._begin(request, before.robot, True)

    def robot_at(self, address: str) -> str:
        """Return the robot whose share the connections and requests of an address take."""
        return self._callers.robot(address)

    def service_actions(self) -> None:
        """End the connections that take too long."""
        for request, connection in list(self._open.items()):
            if monotonic() - connection.since > (_KEPT_SECONDS if connection.kept else _MAX_SECONDS):
                cut(request)

    def shutdown_request(self, request: Any) -> None:
        """A connection has ended."""
        with self._counting:
            self._end(request)
        super().shutdown_request(request)

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Note a connection that broke. That is no error here."""
        _log.debug("a connection of %s broke", client_address, exc_info=True)

    def stop(self) -> None:
        """Close the port."""
        self.socket.shutdown(socket.SHUT_RDWR)  # wakes the thread that waits for connections
        self.shutdown()
        self.server_close()


def _encode(value: Any) -> bytes:
    """An answer, or a fault, in XML."""
    answer = value if isinstance(value, xmlrpc.client.Fault) else (value,)
    return xmlrpc.client.dumps(answer, methodresponse=True, allow_none=True).encode("utf-8", "replace")


def _help(method: Any) -> str:
    function = getattr(method, "method", method)
    return (getattr(getattr(function, "func", function), "__doc__", "") or "").strip()


class BoundedHandler(BaseHTTPRequestHandler):
    """A connection whose heads are bounded: a longer one ends it. Its requests wait until its robot may ask again."""

    throttle: Throttle
    robot: Optional[str] = None  # the robot that pays for the connection; None: no robot pays
    head = 1 << 14  # bytes of all lines of a head; the standard library takes a hundred lines of 64 KiB
    wbufsize = -1
    disable_nagle_algorithm = True
    rfile: Any
    _counted = 0.0  # seconds of a processor that are counted already: its thread began with the connection

    def setup(self) -> None:
        """Begin."""
        super().setup()
        self.rfile = BoundedLines(self.rfile, 0, ConnectionAbortedError)

    def handle_one_request(self) -> None:
        """A request."""
        self.rfile.left = self.head
        if self.robot is not None and not self.throttle.wait(self.robot):
            self.close_connection = True
            self.on_throttled()
            return
        try:
            super().handle_one_request()
        finally:
            self.count_effort()

    def count_effort(self) -> None:
        """Count the time that the thread of the connection has taken since the last time."""
        before, self._counted = self._counted, processor_time()
        if self.robot is not None:
            self.throttle.spend(self.robot, self._counted - before)

    def on_throttled(self) -> None:
        """Note a connection that has ended since its robot has asked too much."""


class _Handler(BoundedHandler):
    server: RpcServer
    timeout = 5.0

    def __init__(self, request: Any, client_address: Any, server: RpcServer) -> None:
        self._kept = False  # another request may follow on this connection
        self._held = contextlib.ExitStack()  # the memory of this request
        self.throttle, self.robot = server.throttle, server.robot_at(client_address[0])
        super().__init__(request, client_address, server)  # serves the connection until its end

    def do_POST(self) -> None:  # the name is the standard library's
        if self.path not in ("/", "/RPC2"):
            self.send_error(404)
            return
        self._kept = False
        try:
            with contextlib.ExitStack() as self._held:
                self._serve_call()
        except NoRoom as problem:
            self.server.malformed(self.client_address[0], f"it has asked for too much at once: {problem}")
            self.close_connection = True
            self.send_error(503)

    def _take(self, size: int, waits: bool = True) -> None:
        """Take memory until the answer has been sent. Raises NoRoom."""
        self._held.enter_context(self.server.room.take(self.robot or "", size, waits))

    def _serve_call(self) -> None:
        """Read a call, and answer it. Raises NoRoom."""
        try:
            name, arguments = self._request()
        except NoRoom:
            raise
        except Exception as problem:  # expat, xmlrpc, gzip and int have a dozen
            self.server.malformed(self.client_address[0], plain(f"{type(problem).__name__}: {problem}"))
            self.send_error(400)
            return
        try:
            answer = self._call(name, arguments)
            body = answer if isinstance(answer, PackedAnswer) else _encode(answer)
        except RefusedCall as refusal:
            body = _encode(xmlrpc.client.Fault(1, plain(refusal, LINE)))
        except Exception as problem:
            _log.debug("%s failed", name, exc_info=True)
            text = plain(f"{name[:100]} failed: {type(problem).__name__}: {problem}")
            self.server.malformed(self.client_address[0], text)
            body = _encode(xmlrpc.client.Fault(1, text))
        self._take(len(body.packed) if isinstance(body, PackedAnswer) else 2 * len(body), False)
        self._answer(body)

    def on_throttled(self) -> None:
        """Say it."""
        self.server.malformed(self.client_address[0], "its robot has asked for more than its share of the processor")

    def _request(self) -> Tuple[str, Tuple[Any, ...]]:
        length = int(self.headers["Content-Length"] or "")
        if not 0 < length <= MAX_REQUEST:
            raise ValueError(f"a request of {length} bytes")
        packed = self.headers.get("Content-Encoding", "identity").lower() == "gzip"
        self._take(_UNPACKED if packed else _READ * length)
        body = self.rfile.read(length)
        arguments, name = loads(body, MAX_REQUEST, packed)
        if not name:
            raise ValueError("no method is named")
        return name, arguments

    def _call(self, name: str, arguments: Tuple[Any, ...]) -> Any:
        method = self.server.methods.get(name)
        if method is None:
            raise RefusedCall(f"there is no method {name[:100]}")
        if isinstance(method, LongPoll):
            self._kept = self.request_version == "HTTP/1.1" and self.server.keep(self.request)
            arguments = (self._kept, *arguments)
        if isinstance(method, PerCaller):
            method, arguments = method.method, (self.client_address[0], *arguments)
        try:
            inspect.signature(method).bind(*arguments)
        except TypeError as problem:
            raise RefusedCall(plain(f"{name}: {problem}")) from None
        return method(*arguments)

    def _answer(self, body: Union[bytes, PackedAnswer]) -> None:
        self.protocol_version = "HTTP/1.1" if self._kept else "HTTP/1.0"
        self.close_connection = not self._kept
        self.send_response(200)
        self.send_header("Content-Type", "text/xml")
        packs = "gzip" in self.headers.get("Accept-Encoding", "")
        pieces: Iterable[bytes]
        if isinstance(body, PackedAnswer):
            pieces = [body.packed] if packs else unpack([body.packed], body.size)
            packed, size = packs, len(body.packed) if packs else body.size
        else:
            packed = packs and len(body) > _COMPRESS
            pieces = [gzip.compress(body, 1) if packed else body]
            size = len(pieces[0])
        if packed:
            self.send_header("Content-Encoding", "gzip")
        self.send_header("Content-Length", str(size))
        self.end_headers()
        for piece in pieces:
            self.wfile.write(piece)
        self.server.sent.add(size)

    def log_message(self, format: str, *arguments: Any) -> None:  # the name is the standard library's
        _log.debug("%s " + format, self.client_address[0], *arguments)


# The server of a program


def callers(members: Members, own_uri: str, is_here: Callable[[str], bool]) -> Callers:
    """The rules for callers. The server listens at all addresses, since the planned one may come late."""
    own = members.master(own_uri)

    def find_refusal(caller: str, address: str) -> str:
        if is_here(caller) or members.strangers == ALLOW:
            return ""
        if own is not None and address not in own.hosts:
            return f"{address} is no address of this computer in the plan"
        return "" if members.knows(caller) else "it is no computer of the fleet"

    def find_robot(address: str) -> str:
        return HERE if is_here(address) else members.robot_at(address)

    robots = [HERE, ALLOWED, *(member.robot for member in members.robots)] if members.robots else [HERE]
    return Callers(find_refusal, find_robot, robots, HERE)


def serve(
    address: str,
    port: int,
    methods: Dict[str, Method],
    malformed: Callable[[str, str], None],
    rules: Callers,
) -> RpcServer:
    """A running server; blocks until the port is free. `malformed(host, why)` is called in threads of the server."""
    logged = False
    while True:
        try:
            return RpcServer(address, port, methods, malformed, rules)
        except OSError as problem:
            if not logged:
                program.LOG.error("port %d for other masters is not free: %s; trying again", port, problem)
                logged = True
            notify(f"STATUS=waiting for TCP port {port}: {problem}", "EXTEND_TIMEOUT_USEC=30000000")
            sleep(1.0)
