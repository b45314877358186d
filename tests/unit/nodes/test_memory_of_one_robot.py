# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The memory that one robot, by all of its addresses, can have a node hold, and that all robots together can."""

import contextlib
import gc
import os
import socket
import threading
import time
import tracemalloc
import xmlrpc.client

import pytest
from rosfleet_multimaster.discovery import state_feed
from rosfleet_multimaster.edge import rpc_server
from rosfleet_multimaster.edge.process.throttle import Throttle
from rosfleet_multimaster.edge.rpc_server import Callers, PackedAnswer, RpcServer
from rosfleet_multimaster.protocol.wire_filters import read_rules

MIB = 1 << 20


@pytest.fixture(name="traced")
def _traced():
    """The bytes that are held, and the most that were, since the test began."""
    gc.collect()
    tracemalloc.start()
    yield tracemalloc.get_traced_memory
    tracemalloc.stop()


# The filters that discovery keeps


def make_filter(number):
    """As many names as a filter may have."""
    return read_rules([False, "|".join(f"\\A{number}{item:x}\\Z" for item in range(6500)), *[""] * 9])


def make_feed():
    return state_feed.StateFeed(lambda: None, robot_at=lambda address: address.partition("-")[0])


@pytest.mark.slow
def test_filters_of_one_robot_have_a_bound(traced):
    feed = make_feed()
    for number in range(24):
        feed._remember(f"hostile-{number % 3}", str(number), make_filter(number))
    assert traced()[0] < 6 * MIB, "half of a MiB for each without a bound"


def test_filters_of_many_push_out_no_others(monkeypatch):
    monkeypatch.setattr(state_feed, "MOST_BYTES", 200_000)
    monkeypatch.setattr(state_feed, "BYTES_OF_ONE", 50_000)
    feed = make_feed()
    few, many = (
        read_rules([False, "|".join(f"\\A{item}\\Z" for item in range(count)), *[""] * 9]) for count in (5, 200)
    )
    feed._remember("friend-1", "mine", few)
    for number in range(40):
        feed._remember(f"hostile{number}-1", "", many)
    assert feed.find_filter("friend-2", "mine") and len(feed._filters) < 6


# Requests and answers under way


class Server:
    """A server that gives each caller another answer of 2.3 MiB, packed, and whose callers from 127.0.3.x are one robot."""

    def __init__(self):
        self.refused = []
        robots = ["hostile", *(f"robot{number}" for number in range(7))]
        who = Callers(robot=lambda address: "hostile" if address.startswith("127.0.3.") else address, robots=robots)
        self.making = threading.Lock()  # as discovery has one
        methods = {"state": self.make_state, "take": lambda _text: 1}
        self.server = RpcServer("", 0, methods, lambda _host, why: self.refused.append(why), who)
        self.server.throttle = Throttle(100.0, 100.0, 100.0, 1.0)

    def make_state(self):
        with self.making:
            return PackedAnswer(os.urandom(2 * MIB).hex())

    def send(self, source, data):
        connection = socket.create_connection(
            ("127.0.0.1", self.server.server_address[1]), 10, source_address=(source, 0)
        )
        with contextlib.suppress(OSError):
            connection.sendall(data)
        return connection

    def ask(self, name, *arguments, source="127.0.0.10"):
        body = xmlrpc.client.dumps(arguments, name).encode()
        return self.send(source, b"POST / HTTP/1.0\r\nContent-Length: %d\r\n\r\n%s" % (len(body), body))


@pytest.fixture(name="made")
def _made(monkeypatch):
    monkeypatch.setattr(rpc_server, "_ROOM", 0.5)
    made = Server()
    yield made
    made.server.stop()


def read_first(connection):
    with connection, contextlib.suppress(OSError):
        return connection.recv(16)
    return b""


@pytest.mark.slow
def test_answers_that_one_robot_does_not_read_have_a_bound(made, traced):
    connections = [made.ask("state", source=f"127.0.3.{number}") for number in range(1, 13)]
    until = time.monotonic() + 10
    while len(made.refused) < 8 and time.monotonic() < until:
        time.sleep(0.05)
    with made.making:
        assert len(made.refused) >= 8 and traced()[0] < 12 * MIB
    assert b"200" in read_first(made.ask("state"))
    for connection in connections:
        connection.close()


def test_requests_of_one_robot_that_do_not_end_have_a_bound(made, traced):
    body = xmlrpc.client.dumps(("x" * 1_000_000,), "take").encode()
    request = b"POST / HTTP/1.0\r\nContent-Length: %d\r\n\r\n%s" % (len(body), body[:-1])
    connections, threads = [], []
    for number in range(1, 17):
        thread = threading.Thread(target=lambda at=number: connections.append(made.send(f"127.0.3.{at}", request)))
        thread.start()
        threads.append(thread)
    for thread in threads:
        thread.join()
    time.sleep(1.0)
    assert made.refused and traced()[0] < 8 * MIB
    assert b"200" in read_first(made.ask("take", "x" * 1_000_000))
    for connection in connections:
        connection.close()
