# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Messages to systemd about the state of the service (sd_notify(3)), and its watchdog."""

import logging
import os
import re
import socket
import struct
from typing import Any, List, Optional

from ...protocol.plain_text import LINE, plain

_log = logging.getLogger("rosfleet.systemd")

_OFTEN = 5.0  # seconds between two signs of life at most: end_hangs.py misses one much earlier than systemd


def notify(*assignments: str) -> None:
    """Notify systemd (sd_notify): "READY=1", "STATUS=...", "STOPPING=1". Does nothing outside a service.

    Each assignment is one line, whatever is in it: a foreign text adds none of its own.
    """
    lines = [plain(text, LINE) for text in assignments]
    _send("\n".join(lines), [], f"sent {lines[0]}")


def _send(message: str, rights: List[Any], what: str) -> None:
    path = os.environ.get("NOTIFY_SOCKET", "")
    if path:
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sender:
            try:
                sender.sendmsg([message.encode()], rights, 0, "\0" + path[1:] if path.startswith("@") else path)
            except OSError as problem:
                _log.warning("systemd cannot be %s: %s", what, problem)


def watchdog() -> Optional[float]:
    """The seconds after which systemd is to hear of this process, again and again; None if it need not."""
    try:
        microseconds = int(os.environ.get("WATCHDOG_USEC", ""))
    except ValueError:
        return None
    meant = os.environ.get("WATCHDOG_PID", "") in ("", str(os.getpid()))
    return min(_OFTEN, microseconds / 4e6) if meant and microseconds > 0 else None


def store_socket(name: str, held: socket.socket) -> None:
    """Have systemd hold a socket while this service is started again (sd_pid_notify_with_fds(3), FDSTORE=1)."""
    rights = [(socket.SOL_SOCKET, socket.SCM_RIGHTS, struct.pack("i", held.fileno()))]
    _send(f"FDSTORE=1\nFDNAME={name}", rights, "given the socket")


def restore_sockets(name: str) -> List[socket.socket]:
    """The sockets of this name that systemd held (sd_listen_fds(3))."""
    if os.environ.pop("LISTEN_PID", "") != str(os.getpid()):
        return []
    names, count = os.environ.pop("LISTEN_FDNAMES", "").split(":"), os.environ.pop("LISTEN_FDS", "0")
    if not re.fullmatch("[0-9]{1,9}", count):
        _log.warning("LISTEN_FDS of systemd is no number, so its sockets are not used: %s", plain(count, LINE))
        return []
    sockets = []
    for number, other in enumerate(names[: int(count)]):
        if other == name:
            held = socket.socket(fileno=3 + number)
            os.set_inheritable(held.fileno(), False)
            sockets.append(held)
    return sockets
