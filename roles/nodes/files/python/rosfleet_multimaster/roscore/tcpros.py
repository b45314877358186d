# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The provider of a service, asked by the header of a connection (http://wiki.ros.org/ROS/TCPROS)."""

import socket
import struct

from ..edge.clock import monotonic
from ..protocol.tcpros.header import decode_fields, encode_header
from ..protocol.tcpros.hosts import place_of

_MOST = 1 << 14  # bytes of a header


def provider(uri: str, service: str, timeout: float) -> str:
    """The node that provides a service at this URI, "" if no node does. Raises OSError, or ValueError for nonsense.

    `timeout`: seconds for connecting, and for the whole answer, however slowly its bytes come.
    """
    place = place_of(uri)
    if not uri.startswith("rosrpc:") or not all(place):
        raise ValueError(f"{uri[:100]} is no address of a service")
    fields = {"callerid": "/master", "service": service, "md5sum": "*", "probe": "1"}
    with socket.create_connection(place, timeout) as connection:
        deadline = monotonic() + timeout
        connection.sendall(encode_header(fields))
        (size,) = struct.unpack("<I", _read(connection, 4, deadline))
        if size > _MOST:
            raise ValueError(f"a header of {size} bytes")
        return decode_fields(_read(connection, size, deadline), "replace").get("callerid", "")


def _read(connection: socket.socket, size: int, deadline: float) -> bytes:
    data = b""
    while len(data) < size:
        left = deadline - monotonic()
        if left <= 0.0:
            raise socket.timeout("timed out")
        connection.settimeout(left)
        piece = connection.recv(size - len(data))
        if not piece:
            raise ConnectionResetError("the connection was closed")
        data += piece
    return data
