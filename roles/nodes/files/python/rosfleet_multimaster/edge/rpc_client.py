# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Calls of XML-RPC methods at other programs."""

import http.client
import socket
import threading
import urllib.parse
import xmlrpc.client
from typing import Any, List, Optional, Sequence, Tuple

from .clock import monotonic
from .xml_rpc import MAX_ANSWER, loads, unpack


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
        deadline = monotonic() + self._timeout  # before the timer: who is cut off is late
        limit = threading.Timer(self._timeout, _cut, (self._connection.sock,))
        limit.daemon = True
        limit.start()
        try:
            return self._exchange(self._connection, body, deadline)
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
