# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Messages to systemd."""

import os
import socket

import pytest
from rosfleet_multimaster.edge.systemd import notify, watchdog


def test_systemd_is_told(tmp_path, monkeypatch):
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as systemd:
        systemd.bind(str(tmp_path / "notify"))
        monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "notify"))
        notify("READY=1")
        assert systemd.recv(100) == b"READY=1"
        notify("STOPPING=1", "STATUS=told\nMAINPID=1\rWATCHDOG=trigger\x1b")
        assert systemd.recv(200) == b"STOPPING=1\nSTATUS=told MAINPID=1 WATCHDOG=trigger\\x1b"
    notify("READY=1")  # nobody listens any more: no error


@pytest.mark.parametrize(
    ("microseconds", "pid", "seconds"),
    [
        ("30000000", None, 30.0),
        ("30000000", str(os.getpid()), 30.0),
        ("30000000", "1", None),
        ("", None, None),
        ("0", None, None),
        ("x", None, None),
    ],
    ids=["everybody", "own", "other", "none", "zero", "no number"],
)
def test_the_time_of_the_watchdog(monkeypatch, microseconds, pid, seconds):
    monkeypatch.setenv("WATCHDOG_USEC", microseconds)
    monkeypatch.delenv("WATCHDOG_PID", raising=False)
    if pid:
        monkeypatch.setenv("WATCHDOG_PID", pid)
    assert watchdog() == seconds
