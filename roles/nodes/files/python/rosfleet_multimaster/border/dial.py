# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Connections: to a publisher, which is a node (wiki.ros.org/ROS/Slave_API) or another border, and those of others.

To connect may block.
"""

import math
import socket
from collections import Counter, deque
from functools import partial
from typing import Any, Container, Deque, Dict, Optional, Tuple

from ..edge.addresses import address_of
from ..edge.loop import Done, Job, Workers
from ..edge.rpc_client import SMALL, Rpc
from ..protocol.members import is_address, place_of
from ..protocol.plain_text import quote

SECONDS = 5.0  # for each question and each connection
AT_ONCE = 2  # connections that are being made to one place
MOST = 300  # connections to one place for topics


class PartyCounts:
    """The things that go on: in all, and those of each party, which is a place or another computer."""

    def __init__(self, most_of_one: int, most: float = math.inf) -> None:
        self._most_of_one, self._most, self._all = most_of_one, most, 0
        self._parties: Counter[str] = Counter()

    def have_room(self, *parties: str) -> bool:
        """True if these may have one more."""
        return self._all < self._most and max(self._parties[party] for party in parties) < self._most_of_one

    def add(self, *parties: str) -> None:
        """Something of these begins."""
        self._all += 1
        self._parties.update(parties)

    def remove(self, *parties: str) -> None:
        """Something of these has ended."""
        self._all -= 1
        self._parties.subtract(parties)
        self._parties += Counter()  # without those that have none


class Dialers:
    """Has connections made in threads, a few at a time for each place. So one that does not answer holds nobody up but itself.

    Used in the loop alone.
    """

    def __init__(self, workers: Workers) -> None:
        self._workers = workers
        self._waiting: Dict[str, Deque[Tuple[Job, Done]]] = {}
        self._busy = PartyCounts(AT_ONCE)
        self.held = PartyCounts(MOST)  # connections for topics

    def submit(self, place: str, job: Job, done: Done) -> None:
        """Make a connection to a place, then call `done(connection, exception)` in the loop."""
        self._waiting.setdefault(place, deque()).append((job, done))
        self._start(place)

    def _start(self, place: str) -> None:
        waiting = self._waiting.get(place)
        while waiting and self._busy.have_room(place):
            job, done = waiting.popleft()
            self._busy.add(place)
            self._workers.submit(job, partial(self._on_done, place, done))
        if not waiting:
            self._waiting.pop(place, None)

    def _on_done(self, place: str, done: Done, connection: Any, problem: Optional[Exception]) -> None:
        self._busy.remove(place)
        self._start(place)
        done(connection, problem)


def dial_node(uri: str, own: str, topic: str, hosts: Container[str]) -> socket.socket:
    """Return a connection to a node of this robot that publishes a topic. Raises OSError or ValueError, and Fault where it refuses.

    `hosts`: of this robot. A node says itself where its messages are to be had.
    """
    host, port = place_of(uri)
    rpc = Rpc(f"http://{_find_address(host, hosts)}:{port}/", SECONDS, SMALL)
    try:
        answer = rpc.call("requestTopic", own, topic, [["TCPROS"]])
    finally:
        rpc.close()
    if not isinstance(answer, list) or len(answer) != 3 or answer[0] != 1:
        raise ValueError(f"{uri} does not publish it")
    protocol = answer[2]
    if (
        not isinstance(protocol, list)
        or len(protocol) != 3
        or not isinstance(protocol[1], str)
        or not isinstance(protocol[2], int)
    ):
        raise ValueError(f"{uri} names no port")
    return _connect(*place_of(f"rosrpc://{protocol[1]}:{protocol[2]}"), hosts)


def dial_service(uri: str, hosts: Container[str]) -> socket.socket:
    """Return a connection to the provider of a service of this robot, at its URI. Raises OSError or ValueError. `hosts`: of this robot."""
    host, port = place_of(uri)
    if not uri.startswith("rosrpc:") or not port:
        raise ValueError(f"{quote(uri)} is no address of a service")
    return _connect(host, port, hosts)


def _connect(host: str, port: int, hosts: Container[str]) -> socket.socket:
    return socket.create_connection((_find_address(host, hosts), port), SECONDS)


def _find_address(host: str, hosts: Container[str]) -> str:
    """Return the address of a host of this robot, so that no name means another one a moment later. Raises OSError or ValueError."""
    address = host if is_address(host) or host not in hosts else address_of(host)
    if address not in hosts:
        raise ValueError(f"{quote(host)} ({quote(address)}) is no computer of this robot")
    return address


def dial_border(place: Tuple[str, int]) -> socket.socket:
    """Return a connection to another border. Raises OSError."""
    return socket.create_connection(place, SECONDS)


def listen() -> socket.socket:
    """Return a socket that takes connections, at a port that the kernel chooses. It does not block."""
    listener = socket.create_server(("", 0), backlog=128)
    listener.setblocking(False)
    return listener
