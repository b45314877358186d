# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""XML-RPC calls at any program: bounded in time, bytes, nesting and memory."""

import socket
import threading
import time
import typing
import xmlrpc.client

from ..._base.deadlines import stretch
from ..._base.plain_text import plain, quote
from .documents import ANSWER, STATE, Document

CALL = 5.0  # seconds that an XML-RPC call may take at the usual pace, from the request to the last byte of the answer

Tables = typing.List[typing.Dict[str, typing.List[str]]]


class _Transport(xmlrpc.client.Transport):
    """HTTP with limits: a node that never answers, one that never ends, and one that sends a byte a second hold no probe."""

    accept_gzip_encoding = False

    def __init__(self, most: int, limit: float) -> None:
        xmlrpc.client.Transport.__init__(self)
        self._most, self._limit = most, limit

    def make_connection(self, host: typing.Any) -> typing.Any:
        connection = xmlrpc.client.Transport.make_connection(self, host)
        connection.timeout = stretch(self._limit)
        return connection

    def single_request(
        self, host: typing.Any, handler: str, request_body: typing.Any, verbose: typing.Any = False
    ) -> typing.Any:
        connection = self.make_connection(host)
        # The socket's own limit begins again with each byte.
        limit = stretch(self._limit)
        deadline = time.monotonic() + limit
        timer = threading.Timer(limit, _cut, (connection,))
        timer.daemon = True
        timer.start()
        try:
            self.send_request(host, handler, request_body, verbose)
            answer = connection.getresponse()
            if answer.status != 200:
                raise xmlrpc.client.ProtocolError(host + handler, answer.status, plain(answer.reason), {})
            return self._read(answer, deadline)
        except Exception:
            if time.monotonic() < deadline:
                raise
            # The limit has cut it, which looks as if the other end had closed it.
            raise socket.timeout(f"no whole answer within {limit:g} s") from None
        finally:
            timer.cancel()
            self.close()

    def _read(self, answer: typing.Any, deadline: float) -> typing.Any:
        document = Document(self._most)
        while True:
            piece = answer.read1(1 << 16)
            if time.monotonic() > deadline:
                raise socket.timeout(f"no whole answer within {stretch(self._limit):g} s")
            if not piece:
                return document.close()[0]
            document.feed(piece)


def server(uri: str, most: int = ANSWER, limit: typing.Optional[float] = None) -> typing.Any:
    """Return an XML-RPC server that is asked with limits; an answer may have `most` bytes, and take `limit` seconds (else CALL) at the usual pace."""
    return xmlrpc.client.ServerProxy(uri, transport=_Transport(most, CALL if limit is None else limit))


class Strange(OSError):
    """Something else than a roscore answers."""


def ask(uri: str, caller: str, method: str, *arguments: typing.Any) -> typing.Any:
    """Call a method of the master API. Raises OSError if the roscore gives no value, and Strange if its answer has another form."""
    try:
        code, message, value = getattr(server(uri, STATE), method)(caller, *arguments)
    except OSError as problem:
        raise OSError(f"{uri}: {problem.strerror or quote(problem)}") from problem
    except xmlrpc.client.Error as problem:  # another XML-RPC server, or another HTTP server
        raise Strange(f"{uri}: {quote(problem)}") from problem
    except Exception as problem:  # http.client's and expat's own
        raise Strange(f"{uri} answers, but not as a roscore ({type(problem).__name__})") from problem
    if code != 1:
        raise OSError(f"{uri}: {method}: {quote(message)}")
    return value


def read_state(uri: str, caller: str) -> Tables:
    """Read publishers, subscribers and services of a roscore: {name: nodes}. Raises OSError, and Strange if the answer has another form."""
    state = ask(uri, caller, "getSystemState")
    try:
        return [{str(name): [str(node) for node in nodes] for name, nodes in state[part]} for part in range(3)]
    except (LookupError, TypeError, ValueError) as problem:
        raise Strange(f"{uri}: no state of a roscore") from problem


def _cut(connection: typing.Any) -> None:
    try:
        connection.sock.shutdown(socket.SHUT_RDWR)
    except (AttributeError, OSError):  # the connection has no socket yet, or it has ended
        pass
