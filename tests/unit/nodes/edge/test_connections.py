# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Real connections in a network namespace; the tests that end connections need root."""

import contextlib
import errno
import os
import pathlib
import socket
import subprocess
import sys
import textwrap
import threading
import time

import pytest
from processes import with_paths
from rosfleet_multimaster.edge import connections

NODES = pathlib.Path(__file__).parents[4] / "roles/nodes/files/python"


def can_end():
    try:
        connections.check()
    except OSError:
        return False
    return True


needs_root = pytest.mark.skipif(os.geteuid() != 0 or not can_end(), reason="needs CAP_NET_ADMIN")


@pytest.fixture(name="pair")
def _pair():
    """A connection over the loopback interface: client, server."""
    with contextlib.ExitStack() as opened:
        listener = opened.enter_context(socket.socket())
        listener.bind(("127.0.0.1", 0))
        listener.listen(1)
        client = opened.enter_context(socket.create_connection(listener.getsockname()))
        server = opened.enter_context(listener.accept()[0])
        yield client, server


def ends(connection):
    """The addresses of both ends: a port of this side alone may serve several connections."""
    return connection.local, connection.remote


def ends_of(client):
    """The same of a socket."""
    return client.getsockname(), client.getpeername()


def of(client):
    """The connection as the kernel lists it."""
    found = [item for item in connections.connections() if ends(item) == ends_of(client)]
    assert len(found) <= 1
    return found[0] if found else None


def test_a_connection_is_listed_with_addresses_and_its_silence(pair):
    client, server = pair
    server.send(b"x")
    client.recv(1)
    time.sleep(0.3)
    found = of(client)
    assert found.remote == client.getpeername()
    assert 0.2 < found.silent < 5
    sent = time.monotonic()
    server.send(b"y")
    silent = of(client).silent
    assert silent < 0.1 + time.monotonic() - sent


@needs_root
def test_both_sides_of_an_ended_connection_are_told_at_once(pair):
    client, server = pair
    errors = []
    waiting = threading.Thread(target=lambda: errors.append(errno_of(lambda: client.recv(1))), daemon=True)
    waiting.start()
    time.sleep(0.1)
    wanted = ends_of(client)
    ended = connections.end_all(lambda item: ends(item) == wanted)
    waiting.join(2.0)
    assert len(ended) == 1 and errors == [errno.ECONNABORTED]
    assert errno_of(lambda: server.recv(1)) == errno.ECONNRESET
    assert not connections.end(ended[0])  # it is gone


def errno_of(call):
    try:
        call()
    except OSError as problem:
        return problem.errno
    return None


@needs_root
def test_nothing_else_is_ended(pair):
    client, server = pair
    assert connections.end_all(lambda item: False) == []
    client.send(b"x")
    assert server.recv(1) == b"x"


IN_A_NAMESPACE = textwrap.dedent(
    """
    import socket, sys, threading, time
    from rosfleet_multimaster.edge import connections

    def connect():
        started = time.monotonic()
        try:
            socket.create_connection(("192.0.2.9", 40000))
        except OSError as problem:
            print(type(problem).__name__, time.monotonic() - started < 5)

    thread = threading.Thread(target=connect)
    thread.start()
    time.sleep(0.5)
    connections.check()
    ended = connections.end_all(lambda item: item.remote == ("192.0.2.9", 40000))
    thread.join()
    print(len(ended))
    """
)


@needs_root
def test_a_connect_to_a_robot_without_power_ends_at_once():
    commands = "ip link set lo up && ip link add d0 type veth peer name d1 && ip link set d1 up && ip addr add 192.0.2.1/24 dev d0 && ip link set d0 up"
    commands += ' && ip neigh add 192.0.2.9 lladdr 02:00:00:00:00:09 dev d0 && exec "$@"'
    words = ["unshare", "--net", "sh", "-c", commands, "sh", sys.executable, "-c", IN_A_NAMESPACE]
    done = subprocess.run(words, capture_output=True, text=True, timeout=30, check=False, env=with_paths())
    assert done.stdout.split() == ["ConnectionAbortedError", "True", "1"], done.stderr


WITHOUT_CAPABILITY = textwrap.dedent(
    """
    import os, sys
    from rosfleet_multimaster.edge import connections
    os.setuid(65534)
    connections.connections()
    try:
        connections.check()
    except PermissionError:
        print("refused")
    """
)


@needs_root
def test_without_the_capability_it_says_so():
    words = [sys.executable, "-c", WITHOUT_CAPABILITY]
    assert (
        subprocess.run(words, capture_output=True, text=True, timeout=30, check=False, env=with_paths()).stdout
        == "refused\n"
    )


def test_what_is_not_between_nodes_is_never_ended(monkeypatch):
    """A robot may say that its node is at port 22, and one that came back may have an ssh from the port of a node."""
    for local, remote in ((40000, 22), (22, 40000)):
        ssh = connections.Tcp(("192.168.1.1", local), ("192.168.1.2", remote), 99.0, b"")
        monkeypatch.setattr(connections, "connections", lambda ssh=ssh: [ssh])
        monkeypatch.setattr(connections, "end", lambda connection: True)
        assert connections.end_all(lambda item: True) == []
