# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Connections are ended by another process, which is asked over a Unix socket: both sides of that conversation.

A request is one message, [[[local address, port], [remote address, port]], ...]; so is the answer, {"ended": [...],
"problem": "..."}. Who may ask is who has the group of the process that answers.
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
_PATIENCE = 5.0  # seconds for an answer: the other process takes its time where it ends much
_CLIENT = 1.0  # seconds that a client may take to ask

Pair = Tuple[Tuple[str, int], Tuple[str, int]]  # (address, port): here, and there


class Answer(NamedTuple):
    """Which connections were ended, and what hindered it."""

    ended: List[Pair]
    problem: str


def end(wanted: Callable[[Tcp], bool], path: str = SOCKET) -> List[Pair]:
    """Have the connections ended that `wanted` names, and return them. Raises OSError where not all could be asked for."""
    found = [(item.local, item.remote) for item in connections() if wanted(item)]
    ended: List[Pair] = []
    for start in range(0, len(found), MOST):
        answer = ask(found[start : start + MOST], path)
        ended += answer.ended
        if answer.problem and not answer.ended:
            raise OSError(answer.problem)
    return ended


def ask(pairs: Sequence[Pair], path: str = SOCKET) -> Answer:
    """Ask the other process to end these connections. Raises OSError where it does not answer."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as asking:
        asking.settimeout(_PATIENCE)
        asking.connect(path)
        asking.send(json.dumps(pairs).encode())
        data = asking.recv(_BYTES)
    try:
        answer = json.loads(data.decode())
        return Answer([_pair(item) for item in answer["ended"]], str(answer["problem"]))
    except (ValueError, KeyError, TypeError):
        raise OSError("what ends connections gave no answer") from None


@contextlib.contextmanager
def listening(path: str) -> Iterator[socket.socket]:
    """The socket of the process that answers. Its group alone may connect to it."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as listener:
        with contextlib.suppress(FileNotFoundError):
            os.unlink(path)
        listener.bind(path)
        os.chmod(path, 0o660)
        listener.listen(8)
        yield listener


def serve_one(listener: socket.socket, patience: float, answer: Callable[[List[Pair]], Answer]) -> int:
    """Answer one request that comes within so many seconds. Return for how many connections it was, or -1 for none."""
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
        except (OSError, ValueError, RecursionError):  # it went away, or asked for nothing that can be understood
            return 0
    return len(pairs)


def _may_ask(client: socket.socket) -> bool:
    """Whoever connects has passed the rights of the folder and of the socket; so this says the same again."""
    _pid, _user, group = struct.unpack("=iII", client.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, 12))
    return bool(group == os.getegid())


def _pairs(data: bytes) -> List[Pair]:
    asked = json.loads(data.decode())
    if not isinstance(asked, list) or len(asked) > MOST:
        raise ValueError("no list, or too long")
    return [_pair(item) for item in asked]


def _pair(item: Any) -> Pair:
    """Two endpoints in JSON. Raises ValueError."""
    try:
        (here, port), (there, other) = item
    except TypeError:
        raise ValueError("no pair of endpoints") from None
    if not all(isinstance(address, str) for address in (here, there)):
        raise ValueError("no addresses")
    if not all(isinstance(at, int) and not isinstance(at, bool) for at in (port, other)):
        raise ValueError("no ports")
    return (here, port), (there, other)
