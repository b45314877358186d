# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The workers that tell nodes what has changed, with real servers on this computer."""

import socket
import threading
import time

import pytest
from rosfleet_multimaster.edge.rpc_server import RpcServer
from rosfleet_multimaster.roscore import notifier as module
from rosfleet_multimaster.roscore.core.notifications import WORKERS
from running_sync import until


class Node:
    """A node that writes down what it is told, and when."""

    def __init__(self):
        self.told, self.come = [], threading.Condition()
        self.server = RpcServer("127.0.0.1", 0, {"publisherUpdate": self.update}, lambda _host, _why: None)
        self.uri = "http://127.0.0.1:%d/" % self.server.server_address[1]

    def update(self, caller, topic, uris):
        with self.come:
            self.told.append((time.monotonic(), caller, topic, uris))
            self.come.notify_all()
        return [1, "", 0]

    def wait(self, count, seconds=5.0):
        with self.come:
            assert self.come.wait_for(lambda: len(self.told) >= count, seconds), self.told


@pytest.fixture
def node():
    found = Node()
    yield found
    found.server.stop()


@pytest.fixture
def deaf():
    """The URIs of nodes that take connections and say nothing."""
    listeners = [socket.create_server(("127.0.0.1", 0)) for _number in range(20)]
    yield [f"http://127.0.0.1:{listener.getsockname()[1]}/" for listener in listeners]
    for listener in listeners:
        listener.close()


def test_an_idle_worker_wakes_at_once(node):
    delays, times = [], []
    notifier = module.Notifier(lambda _call: times.append(time.monotonic()) or True)
    for number in range(20):
        if number:
            until(lambda: notifier._idle)  # it may have yet to read the answer of the last one
        began = time.monotonic()
        notifier.notify(node.uri, "publisherUpdate", f"/topic_{number}", (f"/topic_{number}", ["x"]))
        node.wait(number + 1)
        delays.append(times[-1] - began)  # without what the call itself takes
        time.sleep(0.01)
    assert node.told[0][1:] == ("/master", "/topic_0", ["x"])
    assert sorted(delays)[10] < 0.02, "rosmaster's workers sleep 0.05 s at this place in the middle"


def test_a_burst_is_told_in_few_calls_and_ends_with_what_is_true(node):
    notifier = module.Notifier()
    for number in range(10000):
        notifier.notify(node.uri, "publisherUpdate", "/chatter", ("/chatter", number))
    until(lambda: node.told and node.told[-1][3] == 9999)
    assert len(node.told) <= 7


def test_nodes_that_say_nothing_keep_no_other_waiting(node, deaf):
    notifier = module.Notifier()
    for uri in deaf:
        notifier.notify(uri, "publisherUpdate", "/chatter", ("/chatter", []))
    began = time.monotonic()
    notifier.notify(node.uri, "publisherUpdate", "/chatter", ("/chatter", []))
    node.wait(1)
    assert node.told[0][0] - began < 1.0


def test_workers_are_bounded_and_go(node, monkeypatch):
    monkeypatch.setattr(module, "IDLE", 0.2)
    notifier = module.Notifier()
    for number in range(300):
        notifier.notify(node.uri, "publisherUpdate", f"/topic_{number}", (f"/topic_{number}", []))
        assert notifier._workers <= WORKERS
    node.wait(300, 60)
    until(lambda: notifier._workers == 0)


def test_nobody_there_is_not_tried_again(node):
    notifier = module.Notifier()
    notifier.notify("http://127.0.0.1:1/", "publisherUpdate", "/chatter", ("/chatter", []))
    notifier.notify("no address", "publisherUpdate", "/chatter", ("/chatter", []))
    notifier.notify(node.uri, "publisherUpdate", "/chatter", ("/chatter", []))
    node.wait(1)
    until = time.monotonic() + 10
    while "http://127.0.0.1:1/" in notifier._plan._nodes and time.monotonic() < until:
        time.sleep(0.01)
    assert "http://127.0.0.1:1/" not in notifier._plan._nodes and len(node.told) == 1
