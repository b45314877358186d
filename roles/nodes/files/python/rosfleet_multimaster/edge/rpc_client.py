# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Calls of XML-RPC methods at other programs.

An answer is bounded in bytes, time, nesting and memory. All answers together are bounded too, since many are read at once:
one large answer is read at a time, and one is made into values. The state of 5,000 topics is small on its way, packed.
"""

import contextlib
import hashlib
import http.client
import socket
import threading
import urllib.parse
import xmlrpc.client
from typing import Any, Callable, List, Optional, Sequence, Tuple, Type

from ..protocol.plain_text import plain, quote
from ..protocol.xml_rpc import ANSWER, DocumentTooLarge, loads
from .clock import monotonic
from .loop import Count

SMALL = 1 << 19  # bytes of an answer, as it is sent: a larger one waits for those before it
_HEAD = 1 << 15  # bytes of all lines of the head of an answer, and of those between its chunks

RECEIVED = Count()  # bytes of the answers of other programs

_large, _one_at_a_time = threading.Lock(), threading.Lock()


class Last:
    """The last answer to a question that is asked again and again, by its digest."""

    def __init__(self) -> None:
        self._digest = b""

    def is_again(self, question: bytes, answer: bytearray) -> bool:
        """True if the same question had the same answer the last time."""
        before, self._digest = self._digest, hashlib.sha256(b"%d %s%s" % (len(question), question, answer)).digest()
        return before == self._digest


SAME = object()  # in place of an answer: it is the last one again


class Rpc:
    """Calls at one URI, for one thread at a time. The connection is kept while the other side keeps it."""

    def __init__(self, uri: str, timeout: float, most: int = ANSWER, own: bool = False) -> None:
        """`timeout`: seconds for connecting, and for the whole answer, of at most so many bytes. Raises OSError.

        `own`: the answers of this robot's roscore have room, whatever foreign data is held.
        """
        try:
            parsed = urllib.parse.urlsplit(uri)
            host, port = parsed.hostname, 80 if parsed.port is None else parsed.port
        except ValueError:
            host = port = None
        if not host or not port or parsed.scheme != "http":
            raise OSError(f"{plain(ascii(uri))} is no address of an XML-RPC server")
        self.uri, self._timeout, self._most, self._own = uri, timeout, most, own
        self._host, self._port, self._path = host, port, parsed.path or "/"
        self._connection: Optional[_LimitedConnection] = None
        self._over = False

    def limit(self, seconds: float) -> None:
        """Have so much time for each answer from now on."""
        self._timeout = seconds

    def cut(self) -> None:
        """End the call that is under way, from another thread. There will be no more calls."""
        self._over = True
        connection = self._connection
        if connection is not None and connection.sock is not None:
            cut(connection.sock)

    def call(
        self,
        method: str,
        *arguments: Any,
        read: Callable[[Any], Any] = lambda value: value,
        last: Optional[Last] = None,
    ) -> Any:
        """The result of a method. Raises OSError (no answer), xmlrpc.client.Fault, or ValueError (no XML-RPC).

        `read(value)` makes something smaller of a large answer before the next one is read; it may raise any exception.
        `last`: SAME if the answer is that one. It is not read then, which would cost more than all the rest.
        """
        question = xmlrpc.client.dumps(arguments, method, allow_none=True).encode()
        answer, packed = self._post(question)
        try:
            if last is not None and last.is_again(question, answer):
                return SAME
            if self._most <= SMALL:
                return read(self._value(answer, packed))
            with _one_at_a_time:
                return read(self._value(answer, packed))
        finally:
            if self._is_large(len(answer)):
                _large.release()

    def _value(self, answer: bytearray, packed: bool) -> Any:
        try:
            values, _method = loads(answer, self._most, packed)
            return values[0] if values else None
        except xmlrpc.client.Fault as fault:
            failure: Exception = xmlrpc.client.Fault(fault.faultCode, plain(fault.faultString))
        except DocumentTooLarge as problem:
            failure = DocumentTooLarge(f"{self.uri} answers more than is taken: {plain(problem)}")
        except Exception as problem:
            failure = ValueError(f"{self.uri} answers no XML-RPC: {plain(problem)}")
        raise failure  # out here: inside, it would hold the other one, and with it the values that were read so far

    def multicall(self, calls: Sequence[Tuple[Any, ...]], last: Optional[Last] = None) -> List[Any]:
        """The results of many calls, (method, argument, ...), in one request; a Fault in the place of one that failed.

        `last`: as of `call`; none at all if the answer is that one.
        """
        if not calls:
            return []
        asked = [{"methodName": call[0], "params": list(call[1:])} for call in calls]
        parts = self.call("system.multicall", asked, last=last)
        if parts is SAME:
            return []
        if not isinstance(parts, list) or len(parts) != len(calls):
            raise ValueError(f"{self.uri} does not answer every call")
        return [part[0] if isinstance(part, list) and part else _fault(part) for part in parts]

    def close(self) -> None:
        """Close the connection."""
        if self._connection is not None:
            self._connection.close()
            self._connection = None

    def _post(self, body: bytes) -> Tuple[bytearray, bool]:
        kept = self._connection is not None
        try:
            return self._post_in_time(body)
        except Exception as problem:
            self.close()
            if kept and not self._over and isinstance(problem, (http.client.HTTPException, ConnectionError)):
                return self._post(body)  # the other side had closed the kept connection
            if isinstance(problem, http.client.HTTPException) and not isinstance(problem, OSError):
                raise OSError(f"{self.uri} does not answer as an XML-RPC server") from None
            raise

    def _post_in_time(self, body: bytes) -> Tuple[bytearray, bool]:
        if self._connection is None:
            self._connection = _LimitedConnection(self._host, self._port, timeout=self._timeout)
            self._connection.connect()
        deadline = monotonic() + self._timeout
        self._connection.limit(deadline)
        try:
            return self._exchange(self._connection, body, deadline)
        except (OSError, http.client.HTTPException):
            if monotonic() < deadline:
                raise
            raise OSError(f"{self.uri} answers too slowly") from None

    def _exchange(self, connection: http.client.HTTPConnection, body: bytes, deadline: float) -> Tuple[bytearray, bool]:
        headers = {"Content-Type": "text/xml", "Accept-Encoding": "identity" if self._own else "gzip"}
        connection.request("POST", self._path, body, headers)
        answer = connection.getresponse()
        if answer.status != 200:
            raise OSError(f"{self.uri} answers {answer.status} {quote(answer.reason)}")
        content = self._read(answer, deadline)
        answer.close()  # read1 does not say that it is at the end; else the connection could not be used again
        if answer.will_close:
            self.close()
        if not self._own:
            RECEIVED.add(len(content))
        return content, answer.headers.get("Content-Encoding") == "gzip"

    def _is_large(self, size: int) -> bool:
        return size > SMALL and not self._own

    def _read(self, answer: http.client.HTTPResponse, deadline: float) -> bytearray:
        """Read an answer. Others wait for a large one until its reader has done with it."""
        content, waited = bytearray(), False
        try:
            while True:
                chunk = answer.read1(1 << 16)
                if len(content) + len(chunk) > self._most:
                    raise DocumentTooLarge(
                        f"{self.uri} answers more than is taken: it has more than {self._most} bytes"
                    )
                if not chunk:
                    return content
                content += chunk
                if not waited and self._is_large(len(content)):
                    waited = _large.acquire(timeout=max(0.0, deadline - monotonic()))
                    if not waited:
                        raise OSError(f"{self.uri} answers while other large answers are being read")
        except BaseException:
            if waited:
                _large.release()
            raise


class _Socket(socket.socket):
    """A socket that is read until a time. Its own limit begins again with each byte that comes."""

    deadline = 0.0

    def recv_into(self, *where: Any) -> int:
        """Read. Raises socket.timeout after the deadline."""
        left = self.deadline - monotonic()
        if left <= 0.0:
            raise socket.timeout("timed out")
        self.settimeout(left)
        return super().recv_into(*where)


class _LimitedConnection(http.client.HTTPConnection):
    """A connection with a limit for the whole answer. No thread watches it: one for each call cost more than the call."""

    def connect(self) -> None:
        """Connect."""
        super().connect()
        made, self.response_class = self.sock, _Response
        if made is not None:
            made.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self.sock = _Socket(made.family, made.type, made.proto, fileno=made.detach())

    def limit(self, deadline: float) -> None:
        """Have the next answer read until then."""
        if isinstance(self.sock, _Socket):
            self.sock.deadline = deadline
            self.sock.settimeout(max(0.001, deadline - monotonic()))


class _Response(http.client.HTTPResponse):
    """An answer whose lines (head, and between chunks) are bounded together; each single one may have 64 KiB."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self.fp = BoundedLines(self.fp, _HEAD, http.client.HTTPException)  # type: ignore[assignment]


class BoundedLines:
    """A file of which only `left` bytes can be read by lines. More of them raise `problem`."""

    def __init__(self, file: Any, left: int, problem: Type[Exception]) -> None:
        self._file, self.left, self._problem = file, left, problem

    def readline(self, size: int = -1) -> bytes:
        """Read a line."""
        line: bytes = self._file.readline(self.left + 1 if size < 0 else min(size, self.left + 1))
        self.left -= len(line)
        if self.left < 0:
            raise self._problem("too many lines")
        return line

    def __getattr__(self, name: str) -> Any:
        return getattr(self._file, name)


def cut(connection: socket.socket) -> None:
    """End a connection, which another thread may wait for."""
    with contextlib.suppress(OSError):  # it has ended
        connection.shutdown(socket.SHUT_RDWR)


def _fault(part: Any) -> xmlrpc.client.Fault:
    if isinstance(part, dict):
        return xmlrpc.client.Fault(part.get("faultCode", 1), plain(part.get("faultString", "")))
    return xmlrpc.client.Fault(1, "no result")
