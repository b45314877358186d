# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Messages to systemd."""

import socket

from rosfleet_multimaster.edge.systemd import notify


def test_systemd_is_told(tmp_path, monkeypatch):
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as systemd:
        systemd.bind(str(tmp_path / "notify"))
        monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "notify"))
        notify("READY=1")
        assert systemd.recv(100) == b"READY=1"
        notify("STOPPING=1", "STATUS=told\nMAINPID=1\rWATCHDOG=trigger\x1b")
        assert systemd.recv(200) == b"STOPPING=1\nSTATUS=told MAINPID=1 WATCHDOG=trigger\\x1b"
    notify("READY=1")  # nobody listens any more: no error
