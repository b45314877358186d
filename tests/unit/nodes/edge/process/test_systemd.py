# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Messages to systemd."""

import os
import socket
import subprocess
import sys

import pytest
from processes import with_paths
from rosfleet_multimaster.edge.process.systemd import notify, restore_sockets, store_socket, watchdog


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
        ("30000000", None, 5.0),
        ("400000", None, 0.1),
        ("30000000", str(os.getpid()), 5.0),
        ("30000000", "1", None),
        ("", None, None),
        ("0", None, None),
        ("x", None, None),
    ],
    ids=["everybody", "a short one", "own", "other", "none", "zero", "no number"],
)
def test_the_time_of_the_watchdog(monkeypatch, microseconds, pid, seconds):
    monkeypatch.setenv("WATCHDOG_USEC", microseconds)
    monkeypatch.delenv("WATCHDOG_PID", raising=False)
    if pid:
        monkeypatch.setenv("WATCHDOG_PID", pid)
    assert watchdog() == seconds


def test_systemd_is_given_a_socket_which_is_the_same_one(tmp_path, monkeypatch):
    held = socket.create_server(("127.0.0.1", 0))
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as systemd:
        systemd.bind(str(tmp_path / "notify"))
        monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "notify"))
        store_socket("roscore", held)
        text, numbers, _flags, _address = socket.recv_fds(systemd, 100, 4)
    assert text.split(b"\n") == [b"FDSTORE=1", b"FDNAME=roscore"]
    address = held.getsockname()
    held.close()
    with socket.socket(fileno=numbers[0]) as again, socket.create_connection(address, 2):
        assert again.getsockname() == address and again.accept()
    store_socket("roscore", socket.socket())  # nobody listens any more: no error
    monkeypatch.delenv("NOTIFY_SOCKET")
    store_socket("roscore", socket.socket())  # no service


#: A program that systemd starts with sockets from 3 on: it says which of them are its own, and what its children would have.
STARTED = """
import os, sys
os.environ["LISTEN_PID"] = sys.argv[1].replace("own", str(os.getpid()))
from rosfleet_multimaster.edge.process.systemd import restore_sockets
found = restore_sockets("roscore")
print([held.getsockname()[1] for held in found], [os.get_inheritable(held.fileno()) for held in found])
print(restore_sockets("roscore"), [name for name in os.environ if name.startswith("LISTEN")])
"""


@pytest.mark.parametrize(
    ("pid", "names", "own"),
    [("own", "other:roscore", [1]), ("own", "roscore:roscore", [0, 1]), ("own", "", []), ("1", "roscore:roscore", [])],
    ids=["one", "both", "without names", "of another process"],
)
def test_the_sockets_that_systemd_held(pid, names, own):
    sockets = [socket.create_server(("127.0.0.1", 0)) for _number in range(2)]
    ports = [held.getsockname()[1] for held in sockets]

    def placed():
        for number, held in enumerate(sockets):
            os.dup2(os.dup2(held.fileno(), 20 + number), 3 + number)

    shown = subprocess.run(
        [sys.executable, "-c", STARTED, pid],
        env=with_paths(LISTEN_FDS="2", LISTEN_FDNAMES=names),
        preexec_fn=placed,
        close_fds=False,
        stdout=subprocess.PIPE,
        check=True,
        text=True,
    ).stdout.splitlines()
    for held in sockets:
        held.close()
    assert shown[0] == f"{[ports[number] for number in own]} {[False for _number in own]}"
    assert shown[1].startswith("[]")
    assert pid != "own" or shown[1] == "[] []"


@pytest.mark.parametrize("count", ["", "x", "-1", "1.5", "\u00b2", "9" * 5000])
def test_sockets_without_a_number_are_left_where_they_are(monkeypatch, caplog, count):
    for name, value in {"LISTEN_PID": str(os.getpid()), "LISTEN_FDS": count, "LISTEN_FDNAMES": "roscore"}.items():
        monkeypatch.setenv(name, value)
    assert restore_sockets("roscore") == [] and "LISTEN_FDS" in caplog.text
