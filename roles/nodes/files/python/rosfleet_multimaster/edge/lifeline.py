# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""A connection to another program on which nothing is said. The kernel ends it when that program ends. So no questions are needed."""

import socket
from typing import Callable, Optional

from ..protocol.tcpros.hosts import place_of
from .loop import Loop

CONNECT = 2.0  # seconds

Socket = socket.socket


class Lifeline:
    """The connection to one program. It is opened in any thread, and watched in the loop."""

    def __init__(self, loop: Loop, ended: Callable[[], None]) -> None:
        """`ended()` is called in the loop when the connection has ended."""
        self._loop, self._on_end = loop, ended
        self._held: Optional[Socket] = None
        self.uri = ""  # the program it leads to

    def __bool__(self) -> bool:
        return self._held is not None

    def hold(self, uri: str, opened: Optional[Socket]) -> None:
        """Watch this connection from now on, and no other one; in the loop."""
        self.drop()
        if opened is not None:
            self.uri, self._held = uri, opened
            self._loop.watch(opened, self._readable)

    def drop(self) -> None:
        """Close the connection, without a word."""
        held, self._held, self.uri = self._held, None, ""
        if held is not None:
            self._loop.forget(held)
            held.close()

    def _readable(self) -> None:
        """The other side has closed it; whatever else it may send, it is no use any more."""
        self.drop()
        self._on_end()


def lifeline(uri: str) -> Optional[Socket]:
    """A connection to the program at a URI; None if the connection cannot be made."""
    try:
        return socket.create_connection(place_of(uri), CONNECT)
    except (OSError, UnicodeError):
        return None
