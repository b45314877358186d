# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Connections: to a publisher, which is a node (wiki.ros.org/ROS/Slave_API) or another border, and those of others.

To connect may block.
"""

import socket
import urllib.parse
from typing import Tuple

from ..edge.rpc_client import SMALL, Rpc

SECONDS = 5.0  # for each question and each connection


def dial_node(uri: str, own: str, topic: str) -> socket.socket:
    """Return a connection to a node that publishes a topic. Raises OSError or ValueError, and Fault where it refuses."""
    rpc = Rpc(uri, SECONDS, SMALL)
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
    return socket.create_connection((protocol[1], protocol[2]), SECONDS)


def dial_service(uri: str) -> socket.socket:
    """Return a connection to the provider of a service, at its URI. Raises OSError or ValueError."""
    parsed = urllib.parse.urlsplit(uri)
    if parsed.scheme != "rosrpc" or not parsed.hostname or not parsed.port:
        raise ValueError(f"{uri} is no address of a service")
    return socket.create_connection((parsed.hostname, parsed.port), SECONDS)


def dial_border(place: Tuple[str, int]) -> socket.socket:
    """Return a connection to another border. Raises OSError."""
    return socket.create_connection(place, SECONDS)


def listen() -> socket.socket:
    """Return a socket that takes connections, at a port that the kernel chooses. It does not block."""
    listener = socket.create_server(("", 0), backlog=128)
    listener.setblocking(False)
    return listener
