# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Calls of services on their way: bytes are copied between two connections, in threads, until one of the two ends."""

import contextlib
import socket
from typing import Callable

from ..edge.loop import EndFlag, start_thread
from ..edge.rpc_client import cut
from .wire import keep_alive

_PIECE = 1 << 16  # bytes at once, and all that is held
MOST, MOST_OF_ONE = 200, 50  # calls at once, and those of one other computer, or to one place
IDLE = 3600.0  # seconds of silence after which a call is given up


def splice(client: socket.socket, provider: socket.socket, first: bytes, done: Callable[[], None]) -> None:
    """Copy between a client and a provider, both ways. `first`: what goes to the provider before all else. `done` is called in a thread."""
    for connection in (client, provider):
        connection.settimeout(IDLE)
        with contextlib.suppress(OSError):
            keep_alive(connection)

    asked = EndFlag()

    def copy_there() -> None:
        with contextlib.suppress(OSError):
            provider.sendall(first)
        _copy(client, provider)
        asked.set()

    def copy_back() -> None:
        _copy(provider, client)
        asked.wait()  # a closed socket's number may be another one's already
        client.close()
        provider.close()
        done()

    start_thread("call", copy_there)
    start_thread("answer", copy_back)


def _copy(source: socket.socket, sink: socket.socket) -> None:
    with contextlib.suppress(OSError):
        while True:
            data = source.recv(_PIECE)
            if not data:
                break
            sink.sendall(data)
    cut(source)
    cut(sink)
