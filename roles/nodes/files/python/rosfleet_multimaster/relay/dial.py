# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Connections: to a publisher, which is a node (wiki.ros.org/ROS/Slave_API) or another relay, and incoming ones.

To connect may block.
"""

import socket
from collections import Counter, deque
from functools import partial
from typing import Any, Collection, Container, Deque, Dict, Optional, Set, Tuple

from ..edge.addresses import address_of
from ..edge.core.shares import Shares
from ..edge.loop import Done, Job, Loop, Workers
from ..edge.rpc_client import SMALL, Rpc
from ..protocol.plain_text import quote
from ..protocol.tcpros.hosts import is_address, place_of

SECONDS = 5.0  # for each question and each connection
AT_ONCE = 2  # connections that are being made to one place
THREADS = 8  # that make connections, and two for each robot
MOST_SILENT = 1000  # places that are remembered, since they did not answer
MOST = 300  # connections for topics to one robot


class Dialers:
    """Has connections made in threads, a few at a time for each robot and each place. So a place that gives no answer holds up itself alone.

    Places without an answer yet wait behind the others of their robot. Used only in the loop.
    """

    def __init__(self, loop: Loop, own: str, robots: Collection[str]) -> None:
        """`own`: this robot; `robots`: all of them."""
        threads = THREADS + 2 * len(robots)
        self._workers = Workers(loop, threads)
        self._waiting: Dict[Tuple[str, str], Deque[Tuple[Job, Done]]] = {}  # robot, place
        self._silent: Set[str] = set()  # places
        self._at_once: Counter[str] = Counter()  # by places
        self._busy = Shares(threads, THREADS // 2, robots, own)
        self._slow = Shares(threads // 2, THREADS // 4, robots, own)
        self.held = Shares(MOST * (1 + len(robots)), MOST, robots, own)  # connections for topics

    def submit(self, robot: str, place: str, job: Job, done: Done) -> None:
        """Make a connection to a place of a robot, then call `done(connection, exception)` in the loop."""
        self._waiting.setdefault((robot, place), deque()).append((job, done))
        self._start()

    def _start(self) -> None:
        for robot, place in list(self._waiting):
            waiting, is_slow = self._waiting[robot, place], place in self._silent
            while waiting and self._at_once[place] < AT_ONCE and self._busy.have_room(robot):
                if is_slow and not self._slow.have_room(robot):
                    break
                job, done = waiting.popleft()
                self._count(robot, place, is_slow, 1)
                self._workers.submit(job, partial(self._on_done, robot, place, is_slow, done))
                if waiting:  # behind the other places of its robot
                    self._waiting[robot, place] = self._waiting.pop((robot, place))
            if not waiting:
                self._waiting.pop((robot, place))

    def _count(self, robot: str, place: str, is_slow: bool, number: int) -> None:
        self._at_once[place] += number
        self._at_once += Counter()  # without places that have no connection
        self._busy.add(robot, number)
        if is_slow:
            self._slow.add(robot, number)

    def _on_done(
        self, robot: str, place: str, is_slow: bool, done: Done, connection: Any, problem: Optional[Exception]
    ) -> None:
        self._count(robot, place, is_slow, -1)
        if connection is not None:
            self._silent.discard(place)
        elif len(self._silent) < MOST_SILENT:
            self._silent.add(place)
        self._start()
        done(connection, problem)


def dial_node(uri: str, own: str, topic: str, hosts: Container[str]) -> socket.socket:
    """Return a connection to a node of this robot that publishes a topic. Raises OSError or ValueError, and Fault if it refuses.

    `hosts`: of this robot. A node names the address of its messages itself.
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


def dial_relay(place: Tuple[str, int]) -> socket.socket:
    """Return a connection to another relay. Raises OSError."""
    return socket.create_connection(place, SECONDS)


def listen() -> socket.socket:
    """Return a socket that takes connections, at a port that the kernel chooses. It does not block."""
    listener = socket.create_server(("", 0), backlog=128)
    listener.setblocking(False)
    return listener
