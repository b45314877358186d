# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""A separate process ends connections. It is asked over a Unix socket: here are both sides of that conversation.

A request is one message, [[[local address, port], [remote address, port]], ...]; the answer is one message, too,
{"ended": [...], "problem": "..."}. A client must have the group of the process that answers.
"""

import contextlib
import json
import os
import socket
import struct
from typing import Any, Callable, Iterator, List, NamedTuple, Sequence, Tuple

from ..edge.connections import Tcp, connections

SOCKET = "/run/multimaster-connections/socket"
MOST = 128  # connections in a request
_BYTES = 1 << 16  # of a message
_PATIENCE = 5.0  # seconds for an answer: many connections take long
_CLIENT = 1.0  # seconds that a client may take to ask

Pair = Tuple[Tuple[str, int], Tuple[str, int]]  # (address, port) here, and (address, port) there


class EndedConnections(NamedTuple):
    """The connections that were ended, and the problem with the others."""

    ended: List[Pair]
    problem: str


def end(wanted: Callable[[Tcp], bool], path: str = SOCKET) -> List[Pair]:
    """End the connections that `wanted` selects, and return them. Raises OSError if not all could be asked for."""
    pairs = [(item.local, item.remote) for item in connections() if wanted(item)]
    ended: List[Pair] = []
    for start in range(0, len(pairs), MOST):
        outcome = ask(pairs[start : start + MOST], path)
        ended += outcome.ended
        if outcome.problem and not outcome.ended:
            raise OSError(outcome.problem)
    return ended


def ask(pairs: Sequence[Pair], path: str = SOCKET) -> EndedConnections:
    """Ask the other process to end these connections. Raises OSError if it does not answer."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as asking:
        asking.settimeout(_PATIENCE)
        asking.connect(path)
        asking.send(json.dumps(pairs).encode())
        data = asking.recv(_BYTES)
    try:
        answer = json.loads(data.decode())
        return EndedConnections([_pair(item) for item in answer["ended"]], str(answer["problem"]))
    except (ValueError, KeyError, TypeError):
        raise OSError("the program that ends connections gave no answer") from None


@contextlib.contextmanager
def open_listener(path: str) -> Iterator[socket.socket]:
    """Open the socket of the process that answers. Only its group may connect."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as listener:
        with contextlib.suppress(FileNotFoundError):
            os.unlink(path)
        listener.bind(path)
        os.chmod(path, 0o660)
        listener.listen(8)
        yield listener


def serve_one(listener: socket.socket, patience: float, answer: Callable[[List[Pair]], EndedConnections]) -> int:
    """Answer one request that comes within so many seconds. Return the number of its connections, or -1 without a request."""
    listener.settimeout(patience)
    try:
        client, _address = listener.accept()
    except socket.timeout:
        return -1
    with client:
        client.settimeout(_CLIENT)
        try:
            if not _may_ask(client):
                return 0
            pairs = _pairs(client.recv(_BYTES))
            client.send(json.dumps(answer(pairs)._asdict()).encode())
        except (OSError, ValueError, RecursionError):  # the client went away, or its request is malformed
            return 0
    return len(pairs)


def _may_ask(client: socket.socket) -> bool:
    """True for the own group. The rights of the folder and of the socket have let the client in already."""
    _pid, _user, group = struct.unpack("=iII", client.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, 12))
    return bool(group == os.getegid())


def _pairs(data: bytes) -> List[Pair]:
    items = json.loads(data.decode())
    if not isinstance(items, list) or len(items) > MOST:
        raise ValueError("no list, or too long")
    return [_pair(item) for item in items]


def _pair(item: Any) -> Pair:
    """Two endpoints in JSON. Raises ValueError."""
    try:
        (here, port), (there, other) = item
    except TypeError:
        raise ValueError("no pair of endpoints") from None
    if not all(isinstance(address, str) for address in (here, there)):
        raise ValueError("no addresses")
    if not all(isinstance(number, int) and not isinstance(number, bool) for number in (port, other)):
        raise ValueError("no ports")
    return (here, port), (there, other)
