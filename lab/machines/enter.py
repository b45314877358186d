# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""enter.py SOCKET | ADDRESS PORT: connects, and hands the connection to the ssh client that started it (its option ProxyUseFdpass)."""

import socket
import sys


def connect(words: list[str]) -> socket.socket:
    """The connection to a socket in the file system, or to an address and a port."""
    if len(words) == 2:
        return socket.create_connection((words[0], int(words[1])))
    connection = socket.socket(socket.AF_UNIX)
    connection.connect(words[0])
    return connection


with connect(sys.argv[1:]) as connection, socket.socket(fileno=1) as client:
    socket.send_fds(client, [b"\0"], [connection.fileno()])
