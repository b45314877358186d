# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""UDP, XML-RPC, threads and clocks: everything that touches the outside, except ROS.

A program is one loop in its main thread. Whatever may block runs in a worker and hands its result to the loop; nothing
here changes a setting of the process, such as a default timeout.
"""

import gzip
import http.client
import io
import logging
import os
import queue
import re
import selectors
import socket
import socketserver
import struct
import threading
import time
import urllib.parse
import xmlrpc.client
import zlib
from http.server import BaseHTTPRequestHandler
from typing import Any, Callable, Dict, List, Mapping, NamedTuple, Optional, Sequence, Tuple

monotonic, wall_clock = time.monotonic, time.time

_log = logging.getLogger("rosfleet.sockets")


# The loop and its workers

_MAX_POSTED = 4096  # calls that wait for the loop


class Loop:
    """Runs callbacks one after the other in the thread that calls `run`."""

    def __init__(self) -> None:
        self._selector = selectors.DefaultSelector()
        self._posted: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()
        self._waker, self._wakee = socket.socketpair()
        self._waker.setblocking(False)
        self._wakee.setblocking(False)
        self._selector.register(self._wakee, selectors.EVENT_READ, lambda: None)
        self._thread: Optional[int] = None
        self._running = True

    def post(self, function: Callable[..., Any], *arguments: Any) -> None:
        """Have a function called in the loop; from any thread, and from a signal handler.

        Other threads wait while the loop is behind, so that they cannot fill the memory.
        """
        others = self._thread not in (None, threading.get_ident())  # the loop must not wait for itself
        while others and self._running and self._posted.qsize() >= _MAX_POSTED:
            time.sleep(0.01)
        self._posted.put(lambda: function(*arguments))
        self.wake()

    def wake(self) -> None:
        """End the loop's sleep."""
        try:
            self._waker.send(b"!")
        except OSError:  # full: it is awake already, or closed
            pass

    def watch(self, readable: socket.socket, function: Callable[[], None]) -> None:
        """Have a function called when a socket can be read."""
        self._selector.register(readable, selectors.EVENT_READ, function)

    def forget(self, readable: socket.socket) -> None:
        """Take `watch` back."""
        self._selector.unregister(readable)

    def stop(self) -> None:
        """Let `run` return."""
        self._running = False
        self.wake()

    def run(self, tick: Callable[[float], float]) -> None:
        """Call `tick` with the time until `stop`; it returns the time at which it wants to be called again."""
        self._thread = threading.get_ident()
        while self._running:
            due = tick(monotonic())
            for key, _events in self._selector.select(max(0.0, due - monotonic())):
                key.data()
            try:
                while self._wakee.recv(4096):
                    pass
            except OSError:
                pass
            for _count in range(self._posted.qsize()):
                self._posted.get()()


class Workers:
    """A few threads for what may block. They never keep the process from ending."""

    def __init__(self, loop: Loop, threads: int, waiting: int = 1024) -> None:
        self._loop = loop
        self._jobs: queue.Queue[Tuple[Callable[[], Any], Callable[[Any, Optional[Exception]], None]]] = queue.Queue(
            waiting
        )
        for number in range(threads):
            threading.Thread(target=self._work, name=f"worker-{number}", daemon=True).start()

    def submit(self, job: Callable[[], Any], done: Callable[[Any, Optional[Exception]], None]) -> None:
        """Run a job in a thread, then `done(result, exception)` in the loop."""
        try:
            self._jobs.put_nowait((job, done))
        except queue.Full:
            self._loop.post(done, None, OSError("too much to do at once"))

    def _work(self) -> None:
        while True:
            job, done = self._jobs.get()
            try:
                result, problem = job(), None
            except Exception as error:  # whatever it is belongs to who asked
                result, problem = None, error
            self._loop.post(done, result, problem)


def notify(text: str) -> None:
    """Tell systemd (sd_notify): READY=1, STATUS=..., STOPPING=1. Does nothing outside a service."""
    path = os.environ.get("NOTIFY_SOCKET", "")
    if path:
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sender:
            try:
                sender.sendto(text.encode(), "\0" + path[1:] if path.startswith("@") else path)
            except OSError as problem:
                _log.warning("systemd cannot be told %s: %s", text.splitlines()[0], problem)


# Addresses

_RTM_NEWADDR, _RTM_GETADDR, _NLM_ROOT_REQUEST, _NLMSG_DONE, _IFA_ADDRESS, _IFA_LOCAL = 20, 22, 0x301, 3, 1, 2


def addresses() -> List[Tuple[str, int]]:
    """(IPv4 address, index of its interface) of this computer."""
    found = []
    with socket.socket(socket.AF_NETLINK, socket.SOCK_RAW, 0) as kernel:
        kernel.settimeout(2.0)
        kernel.bind((0, 0))
        kernel.send(struct.pack("=IHHII BBBBI", 24, _RTM_GETADDR, _NLM_ROOT_REQUEST, 1, 0, socket.AF_INET, 0, 0, 0, 0))
        while True:
            data = kernel.recv(65536)
            while data:
                length, kind = struct.unpack_from("=IH", data)
                if kind != _RTM_NEWADDR:
                    return found
                index, parts, at = struct.unpack_from("=I", data, 20)[0], {}, 24
                while at < length:
                    size, part = struct.unpack_from("=HH", data, at)
                    parts[part] = data[at + 4 : at + size]
                    at += (size + 3) & ~3
                address = parts.get(_IFA_LOCAL, parts.get(_IFA_ADDRESS, b""))
                if len(address) == 4:
                    found.append((socket.inet_ntoa(address), index))
                data = data[(length + 3) & ~3 :]


def resolve(name: str) -> str:
    """The IPv4 address of a host name or of a network device. Raises OSError."""
    for index, device in socket.if_nameindex():
        if device == name:
            for address, of in addresses():
                if of == index:
                    return address
    return socket.gethostbyname(name)


# UDP

_IP_PKTINFO = 8
_TTL = 20


class Datagram(NamedTuple):
    """A received datagram."""

    data: bytes
    source: Tuple[str, int]
    multicast: bool


class Udp:
    """The sockets of discovery: everything is sent from, and expected at, the port of the protocol."""

    def __init__(self, group: str, port: int, interface: str, multicast: bool) -> None:
        """`interface`: the address to which discovery is pinned, "" for the kernel's choice. Raises OSError."""
        self.group, self.port, self.interface = group, port, interface
        self.sockets: List[socket.socket] = []
        self._index = dict(addresses()).get(interface, 0) if interface else 0
        if interface and not self._index:
            raise OSError(f"no interface of this computer has the address {interface}")
        try:
            self._sender = self._open(interface)
            if multicast and interface:
                self._join(self._open(group))
            elif multicast:
                self._join(self._sender)
        except OSError:
            self.close()
            raise

    def _open(self, address: str) -> socket.socket:
        opened = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.sockets.append(opened)
        opened.setblocking(False)
        opened.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEPORT, 1)
        opened.setsockopt(socket.IPPROTO_IP, _IP_PKTINFO, 1)
        opened.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, _TTL)
        opened.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_LOOP, 1)
        if self.interface:
            opened.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton(self.interface))
        opened.bind((address, self.port))
        return opened

    def _join(self, member: socket.socket) -> None:
        request = struct.pack("4s4si", socket.inet_aton(self.group), b"\0\0\0\0", self._index)
        member.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, request)

    def close(self) -> None:
        """Close the sockets."""
        for opened in self.sockets:
            opened.close()
        self.sockets = []

    def send(self, datagram: bytes, host: Optional[str]) -> None:
        """Send to the group (None) or to an address. Raises OSError."""
        self._sender.sendto(datagram, (self.group if host is None else host, self.port))

    def receive(self, readable: socket.socket, most: int = 64) -> List[Datagram]:
        """What has arrived, at most so many. Multicast of another interface than the pinned one is dropped."""
        found: List[Datagram] = []
        for _count in range(most):
            try:
                data, ancillary, _flags, source = readable.recvmsg(1024, socket.CMSG_SPACE(12))
            except BlockingIOError:
                break
            except OSError:  # the network says that an earlier datagram did not arrive
                continue
            index, to = 0, b"\0\0\0\0"
            for level, kind, value in ancillary:
                if (level, kind) == (socket.IPPROTO_IP, _IP_PKTINFO):
                    index, _local, to = struct.unpack("i4s4s", value[:12])
            multicast = 224 <= to[0] <= 239
            if not (multicast and self._index and index != self._index):
                found.append(Datagram(data, source, multicast))
        return found


# XML-RPC, the side that is called

MAX_REQUEST = 1 << 20  # bytes
MAX_ANSWER = 64 << 20  # bytes, also unpacked
_MAX_CONNECTIONS, _MAX_PER_ADDRESS = 64, 8
_MAX_SECONDS = 15.0
_COMPRESS = 1400  # bytes


class Refused(Exception):
    """A method's way to answer with a fault: the text is the fault's sentence."""


class PerCaller(NamedTuple):
    """A method whose answer depends on who calls: its first argument is the caller's address."""

    method: Callable[..., Any]

    def __call__(self, caller: str, *arguments: Any) -> Any:
        return self.method(caller, *arguments)


class RpcServer(socketserver.ThreadingMixIn, socketserver.TCPServer):
    """An XML-RPC server with bounds: connections, size of a request, and time of a connection."""

    daemon_threads = True
    block_on_close = False
    allow_reuse_address = True
    request_queue_size = 128

    def __init__(
        self, address: str, port: int, methods: Mapping[str, Callable[..., Any]], malformed: Callable[[str, str], None]
    ) -> None:
        """`malformed(host, why)` is told of every request that is none. Raises OSError where the port is taken."""
        self.methods = dict(methods)
        self.methods["system.listMethods"] = lambda: sorted(self.methods)
        self.methods["system.methodHelp"] = lambda name: _help(self.methods.get(name))
        self.methods["system.methodSignature"] = lambda name: "signatures not supported"
        self.malformed = malformed
        self._open: Dict[socket.socket, Tuple[str, float]] = {}  # whose, and since when
        super().__init__((address, port), _Handler)
        threading.Thread(target=self.serve_forever, name="xml-rpc", kwargs={"poll_interval": 1.0}, daemon=True).start()

    def verify_request(self, request: Any, client_address: Any) -> bool:
        """Refuse what is too much at once."""
        address = client_address[0]
        same = sum(1 for other, _since in list(self._open.values()) if other == address)
        if len(self._open) >= _MAX_CONNECTIONS or same >= _MAX_PER_ADDRESS:
            self.malformed(address, "too many connections at once")
            return False
        self._open[request] = (address, monotonic())
        return True

    def service_actions(self) -> None:
        """End the connections that take too long."""
        for request, (_address, since) in list(self._open.items()):
            if monotonic() - since > _MAX_SECONDS:
                try:
                    request.shutdown(socket.SHUT_RDWR)
                except OSError:
                    pass

    def shutdown_request(self, request: Any) -> None:
        """A connection has ended."""
        self._open.pop(request, None)
        super().shutdown_request(request)

    def handle_error(self, request: Any, client_address: Any) -> None:
        """A connection that breaks is nobody's fault here."""
        _log.debug("a connection of %s broke", client_address, exc_info=True)

    def stop(self) -> None:
        """Close the port."""
        self.socket.shutdown(socket.SHUT_RDWR)  # wakes the thread that waits for connections
        self.shutdown()
        self.server_close()


def _help(method: Any) -> str:
    return (getattr(getattr(method, "method", method), "__doc__", "") or "").strip()


class _Handler(BaseHTTPRequestHandler):
    server: RpcServer
    timeout = 5.0
    wbufsize = -1
    disable_nagle_algorithm = True

    def do_POST(self) -> None:  # the name is the standard library's
        if self.path not in ("/", "/RPC2"):
            self.send_error(404)
            return
        try:
            name, arguments = self._request()
        except Exception as problem:  # expat, xmlrpc, gzip and int have a dozen
            self.server.malformed(self.client_address[0], f"{type(problem).__name__}: {problem}"[:200])
            self.send_error(400)
            return
        try:
            body = xmlrpc.client.dumps((self._call(name, arguments),), methodresponse=True, allow_none=True)
        except Refused as refusal:
            body = xmlrpc.client.dumps(xmlrpc.client.Fault(1, str(refusal)), methodresponse=True)
        except Exception as problem:
            _log.debug("%s failed", name, exc_info=True)
            text = f"{name[:100]} failed: {type(problem).__name__}: {problem}"[:500]
            self.server.malformed(self.client_address[0], text)
            body = xmlrpc.client.dumps(xmlrpc.client.Fault(1, text), methodresponse=True)
        self._answer(body.encode("utf-8", "replace"))

    def _request(self) -> Tuple[str, Tuple[Any, ...]]:
        length = int(self.headers["Content-Length"] or "")
        if not 0 < length <= MAX_REQUEST:
            raise ValueError(f"a request of {length} bytes")
        body = self.rfile.read(length)
        if self.headers.get("Content-Encoding", "identity").lower() == "gzip":
            body = unpack(body, MAX_REQUEST)
        arguments, name = loads(body)
        if not name:
            raise ValueError("no method is named")
        return name, arguments

    def _call(self, name: str, arguments: Tuple[Any, ...]) -> Any:
        method = self.server.methods.get(name)
        if method is None:
            raise Refused(f"there is no method {name[:100]}")
        if isinstance(method, PerCaller):
            arguments = (self.client_address[0], *arguments)
        try:
            return method(*arguments)
        except TypeError as problem:
            raise Refused(f"{name}: {problem}"[:500]) from None

    def _answer(self, body: bytes) -> None:
        self.send_response(200)
        self.send_header("Content-Type", "text/xml")
        if len(body) > _COMPRESS and "gzip" in self.headers.get("Accept-Encoding", ""):
            body = gzip.compress(body, 1)
            self.send_header("Content-Encoding", "gzip")
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, format: str, *arguments: Any) -> None:  # the name is the standard library's
        _log.debug("%s " + format, self.client_address[0], *arguments)


def unpack(body: bytes, most: int) -> bytes:
    """Unpack gzip, but not without a bound. Raises OSError or ValueError."""
    try:
        with gzip.GzipFile(fileobj=io.BytesIO(body)) as packed:
            unpacked = packed.read(most + 1)
    except (EOFError, zlib.error) as problem:
        raise ValueError(str(problem)) from None
    if len(unpacked) > most:
        raise ValueError(f"more than {most} bytes")
    return unpacked


_ENDLESS = re.compile(rb"[0-9]{401}")


def loads(body: bytes) -> Tuple[Tuple[Any, ...], Optional[str]]:
    """The values and the method of an XML-RPC document; document types and entities are not read."""
    if b"<!DOCTYPE" in body or b"<!ENTITY" in body:
        raise ValueError("a document type in an XML-RPC document")
    if b"\0" in body:  # UTF-16, in which they would not be found
        raise ValueError("an XML-RPC document that is not in UTF-8")
    if _ENDLESS.search(body):  # Python before 3.11 takes seconds for such a number, and everything waits
        raise ValueError("a number of more than 400 digits")
    return xmlrpc.client.loads(body, use_builtin_types=True)


# XML-RPC, the side that calls


class Rpc:
    """Calls at one URI, for one thread at a time. The connection is kept while the other side keeps it."""

    def __init__(self, uri: str, timeout: float, most: int = MAX_ANSWER) -> None:
        """`timeout`: seconds for connecting, and for the whole answer, of at most so many bytes. Raises OSError."""
        try:
            parsed = urllib.parse.urlsplit(uri)
            host, port = parsed.hostname, 80 if parsed.port is None else parsed.port
        except ValueError:
            host = port = None
        if not host or not port or parsed.scheme != "http":
            raise OSError(f"{uri[:200]!r} is no address of an XML-RPC server")
        self.uri, self._timeout, self._most = uri, timeout, most
        self._host, self._port, self._path = host, port, parsed.path or "/"
        self._connection: Optional[http.client.HTTPConnection] = None

    def call(self, method: str, *arguments: Any) -> Any:
        """The result of a method. Raises OSError (no answer), xmlrpc.client.Fault, or ValueError (no XML-RPC)."""
        answer = self._post(xmlrpc.client.dumps(arguments, method, allow_none=True).encode())
        try:
            values, _method = loads(answer)
        except xmlrpc.client.Fault:
            raise
        except Exception as problem:
            raise ValueError(f"{self.uri} answers no XML-RPC: {problem}") from None
        return values[0] if values else None

    def multicall(self, calls: Sequence[Tuple[Any, ...]]) -> List[Any]:
        """The results of many calls, (method, argument, ...), in one request; a Fault in the place of one that failed."""
        if not calls:
            return []
        parts = self.call("system.multicall", [{"methodName": call[0], "params": list(call[1:])} for call in calls])
        if not isinstance(parts, list) or len(parts) != len(calls):
            raise ValueError(f"{self.uri} does not answer every call")
        return [part[0] if isinstance(part, list) and part else _fault(part) for part in parts]

    def close(self) -> None:
        """Close the connection."""
        if self._connection is not None:
            self._connection.close()
            self._connection = None

    def _post(self, body: bytes) -> bytes:
        kept = self._connection is not None
        try:
            return self._timed(body)
        except Exception as problem:
            self.close()
            if kept and isinstance(problem, (http.client.HTTPException, ConnectionError)):
                return self._post(body)  # the other side had closed the kept connection
            if isinstance(problem, http.client.HTTPException) and not isinstance(problem, OSError):
                raise OSError(f"{self.uri} does not answer as an XML-RPC server") from None
            raise

    def _timed(self, body: bytes) -> bytes:
        if self._connection is None:
            self._connection = http.client.HTTPConnection(self._host, self._port, timeout=self._timeout)
            self._connection.connect()
            if self._connection.sock is not None:
                self._connection.sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        # The socket's own limit begins again with each byte, so whoever sends one now and then would hold this thread.
        limit = threading.Timer(self._timeout, _cut, (self._connection.sock,))
        limit.daemon = True
        limit.start()
        try:
            return self._exchange(self._connection, body, monotonic() + self._timeout)
        finally:
            limit.cancel()

    def _exchange(self, connection: http.client.HTTPConnection, body: bytes, deadline: float) -> bytes:
        headers = {"Content-Type": "text/xml", "Accept-Encoding": "gzip"}
        connection.request("POST", self._path, body, headers)
        answer = connection.getresponse()
        chunks, size = [], 0
        while True:
            chunk = answer.read1(1 << 16)
            if not chunk:
                break
            chunks.append(chunk)
            size += len(chunk)
            if size > self._most:
                break
        if size > self._most or monotonic() > deadline:
            raise OSError(f"{self.uri} answers too much or too slowly")
        if answer.status != 200:
            raise OSError(f"{self.uri} answers {answer.status} {answer.reason}")
        if answer.will_close:
            self.close()
        content = b"".join(chunks)
        return unpack(content, self._most) if answer.headers.get("Content-Encoding") == "gzip" else content


def _cut(connection: socket.socket) -> None:
    try:
        connection.shutdown(socket.SHUT_RDWR)
    except OSError:  # it has ended
        pass


def _fault(part: Any) -> xmlrpc.client.Fault:
    if isinstance(part, dict):
        return xmlrpc.client.Fault(part.get("faultCode", 1), str(part.get("faultString", "")))
    return xmlrpc.client.Fault(1, "no result")


class Roscore:
    """The master API of a roscore. Its answers are [code, text, value]."""

    def __init__(self, uri: str, caller: str, timeout: float = 5.0) -> None:
        self.rpc, self.caller = Rpc(uri, timeout), caller

    def ask(self, *calls: Tuple[Any, ...]) -> List[Any]:
        """The values of many calls (without the caller's name) in one request; None where one was refused.

        Raises OSError, ValueError or xmlrpc.client.Fault where the roscore does not answer at all.
        """
        results = self.rpc.multicall([(call[0], self.caller, *call[1:]) for call in calls])
        return [_value(result) for result in results]


def _value(result: Any) -> Any:
    if isinstance(result, (list, tuple)) and len(result) == 3 and result[0] == 1:
        return result[2]
    return None
