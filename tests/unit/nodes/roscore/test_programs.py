# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The owner of the other end of a connection, as the kernel says; with real connections, and another user where this one is root."""

import os
import socket
import subprocess
import sys

import pytest
from rosfleet_multimaster.edge import connections
from rosfleet_multimaster.roscore import programs

CONNECT = """
import os, socket, sys
os.setgid(65534); os.setuid(65534)
connection = socket.create_connection(("127.0.0.1", int(sys.argv[1])))
sys.stdin.read()
"""


@pytest.fixture
def server():
    with socket.create_server(("127.0.0.1", 0)) as found:
        yield found


def test_an_own_connection_is_own(server):
    with socket.create_connection(server.getsockname()):
        accepted, there = server.accept()
        with accepted:
            assert connections.owner(there, accepted.getsockname()) == os.geteuid()
            assert programs.is_own(there, accepted.getsockname())


def test_an_end_that_is_not_of_this_computer_is_not_own(server):
    assert not programs.is_own(("192.0.2.1", 40000), server.getsockname())
    assert not programs.is_own(("127.0.0.1", 1), server.getsockname())
    assert not programs.is_own(("2001:db8::1", 40000), ("2001:db8::2", 11311))


@pytest.mark.skipif(os.geteuid() != 0, reason="only root has processes of other users")
def test_a_connection_of_the_user_of_the_service_is_own(server, tmp_path, monkeypatch):
    monkeypatch.setattr(programs, "SERVICE", str(tmp_path))
    words = ["/usr/bin/python3" if os.path.exists("/usr/bin/python3") else sys.executable, "-c", CONNECT]
    words.append(str(server.getsockname()[1]))
    with subprocess.Popen(words, stdin=subprocess.PIPE) as other:
        accepted, there = server.accept()
        with accepted:
            assert connections.owner(there, accepted.getsockname()) == 65534
            assert not programs.is_own(there, accepted.getsockname())
            os.chown(tmp_path, 65534, 65534)
            assert programs.is_own(there, accepted.getsockname())
        other.stdin.close()
