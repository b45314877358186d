# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The life of the sockets, without sockets."""

import threading
import types

from rosfleet_multimaster.core.discovery import Send
from rosfleet_multimaster.edge.loop import Loop, Workers
from rosfleet_multimaster.parts import datagrams as module
from rosfleet_multimaster.parts import program

VALUES = {
    "mcast_group": "226.0.0.0",
    "mcast_port": 11511,
    "interface": "",
    "send_mcast": True,
    "listen_mcast": True,
    "robot_hosts": [],
}


def made(errors=None, threads=1, **values):
    loop = Loop()
    return module.Datagrams(
        {**VALUES, **values}, loop, Workers(loop, threads), program.Limited(), {} if errors is None else errors
    )


def udp(send=lambda *arguments: None):
    return types.SimpleNamespace(sockets=[], close=lambda: None, send=send)


def test_sockets_are_opened_again_where_the_kernel_did_not_list_the_addresses(monkeypatch):
    def busy():
        raise OSError("timed out")

    monkeypatch.setattr(module, "Udp", lambda *arguments: udp())
    monkeypatch.setattr(module, "addresses", busy)
    node = made()
    assert node.tick(100.0) > 100.0  # else nobody would ever read from them


def test_a_network_that_has_gone_makes_new_sockets_and_is_told(monkeypatch):
    def gone(*arguments):
        raise OSError("Network is unreachable")

    opened = []
    monkeypatch.setattr(module, "Udp", lambda *arguments: udp(gone if not opened else lambda *sent: None))
    errors = {}
    node = made(errors)
    node.tell(lambda datagram, now: None, lambda: None, opened.append)
    assert node.tick(100.0) is None and opened == [100.0]
    opened.clear()
    node.send(Send(b"x", None))
    assert "unreachable" in errors["send None"] and node.tick(0.0) > 0.0
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
