# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The life of the sockets, without sockets."""

import logging
import threading
import types

import pytest
from rosfleet_multimaster.discovery import datagrams as module
from rosfleet_multimaster.discovery.core.actions import Send
from rosfleet_multimaster.edge.addresses import Network
from rosfleet_multimaster.edge.loop import Loop, Workers
from rosfleet_multimaster.edge.process import program

VALUES = {
    "mcast_group": "226.0.0.0",
    "mcast_port": 11511,
    "interface": "",
    "send_mcast": True,
    "listen_mcast": True,
    "robot_hosts": [],
}


def made(errors=None, threads=1, opened=lambda now: None, **values):
    loop, callbacks = Loop(), module.DatagramCallbacks(lambda datagram, now: None, lambda: None, opened, lambda: None)
    errors = {} if errors is None else errors
    return module.Datagrams({**VALUES, **values}, loop, Workers(loop, threads), program.LimitedLog(), errors, callbacks)


def udp(send=lambda *arguments: None):
    return types.SimpleNamespace(sockets=[], close=lambda: None, send=send)


def test_sockets_are_opened_again_after_a_lost_address_list(monkeypatch):
    def busy():
        raise OSError("timed out")

    monkeypatch.setattr(module, "Udp", lambda *arguments: udp())
    monkeypatch.setattr(module, "network", busy)
    node = made()
    assert node.tick(100.0) > 100.0  # else nobody would ever read from them


def test_a_network_that_has_gone_makes_new_sockets_and_is_told(monkeypatch):
    def gone(*arguments):
        raise OSError("Network is unreachable")

    opened, clock = [], [100.0]
    monkeypatch.setattr(module, "monotonic", lambda: clock[0])
    monkeypatch.setattr(module, "Udp", lambda *arguments: udp(gone if not opened else lambda *sent: None))
    errors = {}
    node = made(errors, opened=opened.append)
    assert node.tick(100.0) is None and opened == [100.0]
    opened.clear()
    node.send(Send(b"x", None))
    assert "unreachable" in errors["send None"] and node.tick(0.0) > 0.0
    clock[0] = 1e12
    node.tick(1e12)
    assert opened == [1e12]


def test_a_name_server_that_hangs_does_not_stop_later_looks(monkeypatch):
    asked, second, release = [], threading.Event(), threading.Event()

    def look(hosts):
        asked.append(hosts)
        if len(asked) == 1:
            release.wait(30)
        else:
            second.set()
        return {}

    monkeypatch.setattr(module, "Udp", lambda *arguments: udp())
    monkeypatch.setattr(module, "addresses_of_all", look)
    node = made(threads=2, robot_hosts=["third"])
    try:
        assert node.tick(100.0) == 100.0 + module.RESOLVE
        node.tick(100.0 + module.RESOLVE)
        assert second.wait(10) and not release.is_set()
    finally:
        release.set()


def run_until(node, is_done):
    """Run the loop of a node until that is true."""

    def tick(now):
        if is_done():
            node._loop.stop()
        return now + 0.01

    node._loop.run(tick)


def test_a_name_server_that_hangs_does_not_stop_the_loop(monkeypatch):
    answer = threading.Event()

    def resolve(_name):
        assert answer.wait(30)
        return "192.168.1.1"

    opened = []
    monkeypatch.setattr(module, "Udp", lambda *arguments: udp() if arguments[2] == "192.168.1.1" else None)
    monkeypatch.setattr(module, "resolve", resolve)
    node = made(opened=opened.append, interface="robot")
    threading.Timer(5.0, answer.set).start()  # what waits for it is not stopped for ever
    node.start()
    assert node.tick(1e12) is None and not answer.is_set() and not opened
    assert "127.0.0.1" in node.own_addresses, "who is here is known at once"
    answer.set()
    run_until(node, lambda: opened)
    assert node.tick(0.0) is None and node.problem == ""


@pytest.mark.parametrize("problem", [OSError("Name or service not known"), UnicodeError("label empty or too long")])
def test_an_interface_without_an_address_is_waited_for(monkeypatch, problem):
    def resolve(_name):
        raise problem

    monkeypatch.setattr(module, "resolve", resolve)
    node = made(interface="nobody")
    node.tick(1.0)
    run_until(node, lambda: node.problem)
    assert f"on nobody: {problem}" in node.problem and node.tick(0.0) == 1.0 + module.REOPEN


PLANNED = "192.168.1.1"
ALONE = Network({"127.0.0.1": 1}, {"127.0.0.1", PLANNED}, {1})  # a local route to the planned address
UNPLUGGED = Network({"127.0.0.1": 1, PLANNED: 2}, {"127.0.0.1", PLANNED}, {1})
PLUGGED = Network({"127.0.0.1": 1, PLANNED: 2}, {"127.0.0.1", PLANNED}, {1, 2})
ON_WIFI = Network({"127.0.0.1": 1, PLANNED: 3}, {"127.0.0.1", PLANNED}, {1, 2, 3})


class Played:
    """Datagrams in a network that is played; no socket opens without the planned address."""

    def __init__(self, monkeypatch, network):
        self.network, self.opened, self.errors = network, [], {}
        monkeypatch.setattr(module, "network", lambda: self.network)
        monkeypatch.setattr(module, "Udp", self.udp)
        self.node = made(self.errors, opened=self.opened.append, interface=PLANNED)
        self.send = lambda *arguments: None

    def udp(self, *_arguments):
        if PLANNED not in self.network.interfaces:
            raise OSError(f"no interface of this computer has the address {PLANNED}")
        return udp(self.sent)

    def sent(self, *arguments):
        self.send(*arguments)  # what a test has put there


class Lines(logging.Handler):
    """The lines that the node writes into its log."""

    def __init__(self, monkeypatch):
        super().__init__()
        self.records = []
        monkeypatch.setattr(program.LOG, "handlers", [self])

    def emit(self, record):
        self.records.append(record)


def test_the_wait_for_an_address_is_one_line_of_the_log(monkeypatch):
    log = Lines(monkeypatch)
    played = Played(monkeypatch, ALONE)
    for second in range(600):
        played.node.tick(100.0 + second)
    assert [record.levelname for record in log.records] == ["WARNING"]
    assert "waiting for it" in log.records[0].getMessage()
    assert played.node.own_addresses >= {PLANNED, "127.0.0.1"} and played.opened == []


@pytest.mark.parametrize("before, after", [(ALONE, PLUGGED), (UNPLUGGED, PLUGGED), (PLUGGED, ON_WIFI)])
def test_sockets_are_opened_when_the_link_comes(monkeypatch, before, after):
    monkeypatch.setattr(module, "monotonic", lambda: 100.2)
    played = Played(monkeypatch, before)
    played.node.tick(100.0)
    played.opened.clear()
    played.network = after
    played.node.look_at_addresses()
    assert played.node.tick(100.2) is None and played.opened == [100.2]


def test_a_link_that_is_down_is_no_error(monkeypatch):
    def down(*_arguments):
        raise OSError("Network is unreachable")

    played = Played(monkeypatch, UNPLUGGED)
    played.node.tick(100.0)
    played.send = down
    played.node.send(Send(b"x", None))
    assert played.errors == {} and played.node.tick(100.0) is None
    played.network = PLUGGED
    played.node.look_at_addresses()
    played.node.tick(1e12)
    played.node.send(Send(b"x", None))
    assert "unreachable" in played.errors["send None"]
