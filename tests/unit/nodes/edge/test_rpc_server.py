# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The XML-RPC server with real sockets: HTTP on 127.0.0.1."""

import gzip
import socket
import tracemalloc
import xmlrpc.client

import pytest
from rosfleet_multimaster.edge.clock import monotonic
from rosfleet_multimaster.edge.rpc_client import Rpc
from rosfleet_multimaster.edge.rpc_server import PackedAnswer, PerCaller, RefusedCall, RpcServer


class Server:
    def __init__(self):
        self.malformed = []
        methods = {
            "add": lambda a, b: a + b,
            "big": lambda: ["x" * 100] * 100,
            "refuse": self.refuse,
            "nil": lambda: None,
            "broken": lambda: 1 / 0,
            "untyped": lambda: [] + 1,
            "here": PerCaller(lambda caller, word: f"{word} {caller}"),
        }
        self.server = RpcServer("127.0.0.1", 0, methods, lambda host, why: self.malformed.append(why))
        self.port = self.server.server_address[1]
        self.uri = f"http://127.0.0.1:{self.port}"

    def refuse(self):
        raise RefusedCall("no state yet")

    def raw(self, data, wait=3.0):
        with socket.create_connection(("127.0.0.1", self.port), wait) as connection:
            connection.sendall(data)
            connection.shutdown(socket.SHUT_WR)
            answer = b""
            while True:
                part = connection.recv(65536)
                if not part:
                    return answer
                answer += part


@pytest.fixture
def server():
    made = Server()
    yield made
    made.server.stop()


def post(body, path="/RPC2", length=None, more=""):
    return (
        f"POST {path} HTTP/1.0\r\nContent-Length: {len(body) if length is None else length}\r\n{more}\r\n".encode()
        + body
    )


CALL = xmlrpc.client.dumps((1, 2), "add").encode()


def test_the_standard_librarys_client_and_ours_agree(server):
    theirs, ours = xmlrpc.client.ServerProxy(server.uri, allow_none=True), Rpc(server.uri, 3.0)
    assert theirs.add(1, 2) == ours.call("add", 1, 2) == 3
    assert theirs.big() == ours.call("big") == ["x" * 100] * 100
    assert theirs.nil() is ours.call("nil") is None
    assert "add" in theirs.system.listMethods()
    assert server.malformed == []


def test_long_answers_are_compressed_for_who_can_read_it(server):
    body = xmlrpc.client.dumps((), "big").encode()
    assert b"gzip" not in server.raw(post(body))
    head, _gap, packed = server.raw(post(body, more="Accept-Encoding: gzip\r\n")).partition(b"\r\n\r\n")
    assert b"Content-Encoding: gzip" in head and b"xxx" in gzip.decompress(packed)


@pytest.mark.parametrize(
    "call", [("refuse",), ("unknown",), ("add", 1), ("here",), ("here", 1, 2), ("system.multicall", [])]
)
def test_a_mistake_of_the_caller_is_a_fault(server, call):
    with pytest.raises(xmlrpc.client.Fault):
        Rpc(server.uri, 3.0).call(*call)
    assert server.malformed == [] and Rpc(server.uri, 3.0).call("here", "at") == "at 127.0.0.1"


@pytest.mark.parametrize(("name", "error"), [("broken", "ZeroDivisionError"), ("untyped", "TypeError")])
def test_a_mistake_of_a_method_is_told_here_too(server, name, error):
    with pytest.raises(xmlrpc.client.Fault, match=f"{name} failed: {error}"):
        Rpc(server.uri, 3.0).call(name)
    (told,) = server.malformed
    assert told.startswith(f"{name} failed: {error}: ")


@pytest.mark.parametrize(
    "data",
    [
        post(b"hello"),
        post(b"<methodCall><methodName>add</methodName>"),
        post(CALL, length=5),
        post(CALL, length=1 << 40),
        post(CALL, length=-1),
        post(CALL, length="x"),
        b"POST / HTTP/1.0\r\n\r\n" + CALL,
        post(b'<!DOCTYPE a [<!ENTITY b "c">]>' + CALL),
        post(b"<methodResponse><params><param><value><int>1</int></value></param></params></methodResponse>"),
        post(gzip.compress(b" " * (2 << 20)), more="Content-Encoding: gzip\r\n"),
        post(b"no gzip", more="Content-Encoding: gzip\r\n"),
        post(b"\xff\xfe\x00"),
        post(CALL.decode().replace("?>", "?><!DOCTYPE methodCall>").encode("utf-16")),
    ],
)
def test_a_malformed_request_is_counted_and_changes_nothing(server, data):
    assert server.raw(data).startswith(b"HTTP/1.0 400")
    assert len(server.malformed) == 1
    assert Rpc(server.uri, 3.0).call("add", 1, 2) == 3


@pytest.mark.parametrize(
    ("data", "status"), [(b"GET / HTTP/1.0\r\n\r\n", b"501"), (post(CALL, "/other"), b"404"), (post(CALL, "/"), b"200")]
)
def test_methods_and_paths_of_http(server, data, status):
    assert status in server.raw(data).split(b"\r\n")[0]


def test_a_server_stops_at_once(server):
    started = monotonic()
    other = Server()
    other.server.stop()
    assert monotonic() - started < 5.0
    with pytest.raises(OSError):
        Rpc(other.uri, 1.0).call("add", 1, 2)


def test_a_large_answer_is_held_packed_by_who_does_not_read_it():
    """A whole state with all others has 20 MB: eight such connections of one computer held 330 MB of the unit's 512."""
    answer = PackedAnswer("x" * 40_000_000)
    server = RpcServer("127.0.0.1", 0, {"state": lambda: answer}, lambda *_why: None)
    body = xmlrpc.client.dumps((), "state").encode()
    question = b"POST / HTTP/1.0\r\nContent-Length: %d\r\n\r\n%s" % (len(body), body)
    tracemalloc.start()
    try:
        callers = [socket.create_connection(server.server_address) for _number in range(6)]
        for caller in callers:
            caller.sendall(question)
        for caller in callers:
            assert caller.recv(4) == b"HTTP"
        assert tracemalloc.get_traced_memory()[1] < 20_000_000
        with callers[0].makefile("rb") as answered:
            read = len(answered.read())
        assert read > answer.size, "whoever reads has all of it"
    finally:
        tracemalloc.stop()
        server.stop()
        for caller in callers:
            caller.close()
