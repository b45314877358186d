# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Messages to systemd about the state of the service (sd_notify(3)), and its watchdog."""

import logging
import os
import socket
from typing import Optional

from ..core.plain_text import LINE, plain

_log = logging.getLogger("rosfleet.systemd")


def notify(*assignments: str) -> None:
    """Tell systemd (sd_notify): "READY=1", "STATUS=...", "STOPPING=1". Does nothing outside a service.

    Each assignment is one line, whatever stands in it: a text of others adds none of its own.
    """
    path, lines = os.environ.get("NOTIFY_SOCKET", ""), [plain(text, LINE) for text in assignments]
    if path:
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sender:
            try:
                sender.sendto("\n".join(lines).encode(), "\0" + path[1:] if path.startswith("@") else path)
            except OSError as problem:
                _log.warning("systemd cannot be told %s: %s", lines[0], problem)


def watchdog() -> Optional[float]:
    """The seconds within which systemd wants to hear of this process, again and again; None where it does not."""
    try:
        microseconds = int(os.environ.get("WATCHDOG_USEC", ""))
    except ValueError:
        return None
    meant = os.environ.get("WATCHDOG_PID", "") in ("", str(os.getpid()))
    return microseconds / 1e6 if meant and microseconds > 0 else None
