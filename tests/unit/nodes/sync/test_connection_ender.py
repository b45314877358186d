# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The conversation with the process that ends connections, over a real socket."""

import contextlib
import os
import socket
import stat
import threading

import pytest
from rosfleet_multimaster.edge.connections import Tcp
from rosfleet_multimaster.sync import connection_ender as ender

PAIRS = [(("192.168.1.1", 41000), ("192.168.1.2", 40000)), (("192.168.1.1", 41001), ("192.168.1.2", 40001))]


@contextlib.contextmanager
def answering(path, answer, requests=1):
    counts = []
    with ender.open_listener(path) as listener:
        serving = threading.Thread(
            target=lambda: counts.extend(ender.serve_one(listener, 5.0, answer) for _count in range(requests))
        )
        serving.start()
        yield counts
        serving.join(10.0)


def test_a_request_and_its_answer(tmp_path):
    path, asked = str(tmp_path / "socket"), []

    def answer(pairs):
        asked.append(pairs)
        return ender.EndedConnections(pairs[:1], "the other one is none of ours")

    with answering(path, answer) as counts:
        assert stat.S_IMODE(os.stat(path).st_mode) == 0o660
        assert ender.ask(PAIRS, path) == ender.EndedConnections(PAIRS[:1], "the other one is none of ours")
    assert (asked, counts) == ([PAIRS], [2])


def test_many_connections_are_many_requests(tmp_path, monkeypatch):
    path = str(tmp_path / "socket")
    found = [Tcp(("192.168.1.1", 30000 + count), ("192.168.1.2", 40000), 0.0, b"") for count in range(300)]
    monkeypatch.setattr(ender, "connections", lambda: found)
    with answering(path, lambda pairs: ender.EndedConnections(pairs, ""), 3) as counts:
        assert len(ender.end(lambda item: item.local[1] != 30007, path)) == 299
    assert counts == [128, 128, 43]


def test_where_nothing_could_be_ended_it_says_why(tmp_path, monkeypatch):
    path = str(tmp_path / "socket")
    monkeypatch.setattr(ender, "connections", lambda: [Tcp(*PAIRS[0], 0.0, b"")])
    with (
        answering(path, lambda pairs: ender.EndedConnections([], "no right to")),
        pytest.raises(OSError, match="no right to"),
    ):
        ender.end(lambda item: True, path)
    with pytest.raises(OSError):
        ender.end(lambda item: True, str(tmp_path / "nobody"))
    assert ender.end(lambda item: False, str(tmp_path / "nobody")) == []


MANY = b"[" + b",".join([b'[["192.168.1.1",1],["192.168.1.2",2]]'] * (ender.MOST + 1)) + b"]"


@pytest.mark.parametrize(
    "request_text",
    [
        b"",
        b"x",
        b"\xff",
        b"null",
        b"{}",
        b"[1]",
        b"[[1]]",
        b'[[["a"],["b"]]]',
        b'[[["a","1"],["b","2"]]]',
        b"[" * 9999,
        MANY,
    ],
)
def test_a_wrong_request_has_no_answer_and_hinders_no_other(tmp_path, request_text):
    path = str(tmp_path / "socket")
    with answering(path, lambda pairs: ender.EndedConnections(pairs, ""), 2) as counts:
        with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as asking:
            asking.connect(path)
            asking.send(request_text)
            asking.settimeout(5.0)
            with contextlib.suppress(ConnectionResetError):
                assert asking.recv(100) == b""
        assert ender.ask(PAIRS, path).ended == PAIRS
    assert counts == [0, 2]


def test_who_says_nothing_hinders_others_for_a_second_alone(tmp_path):
    path = str(tmp_path / "socket")
    with answering(path, lambda pairs: ender.EndedConnections(pairs, ""), 2) as counts:
        with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as silent:
            silent.connect(path)
            assert ender.ask(PAIRS, path).ended == PAIRS
    assert counts == [0, 2]


def test_another_group_is_not_answered(tmp_path, monkeypatch):
    path, group = str(tmp_path / "socket"), os.getegid()
    with answering(path, lambda pairs: ender.EndedConnections(pairs, "")) as counts:
        monkeypatch.setattr(os, "getegid", lambda: group + 1)
        with pytest.raises(OSError):
            ender.ask(PAIRS, path)
    assert counts == [0]
