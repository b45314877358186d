# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Visitors of the doors of background processes."""

import socket


def leave_silently(path):
    """Visit a door without a request, as a program does that was held up for too long; wait until the process has seen it."""
    with socket.socket(socket.AF_UNIX) as visitor:
        visitor.connect(str(path))
        visitor.shutdown(socket.SHUT_WR)
        visitor.settimeout(10)
        assert visitor.recv(1) == b""
