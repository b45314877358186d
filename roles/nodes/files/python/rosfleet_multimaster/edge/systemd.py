# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Messages to systemd about the state of the service (sd_notify(3))."""

import logging
import os
import socket

_log = logging.getLogger("rosfleet.systemd")


def notify(text: str) -> None:
    """Tell systemd (sd_notify): READY=1, STATUS=..., STOPPING=1. Does nothing outside a service."""
    path = os.environ.get("NOTIFY_SOCKET", "")
    if path:
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sender:
            try:
                sender.sendto(text.encode(), "\0" + path[1:] if path.startswith("@") else path)
            except OSError as problem:
                _log.warning("systemd cannot be told %s: %s", text.splitlines()[0], problem)
