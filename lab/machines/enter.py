# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""enter.py SOCKET: connects, and hands the connection to the ssh client that started it (its option ProxyUseFdpass)."""

import socket
import sys

with socket.socket(socket.AF_UNIX) as connection, socket.socket(fileno=1) as client:
    connection.connect(sys.argv[1])
    socket.send_fds(client, [b"\0"], [connection.fileno()])
