# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Real sockets: HTTP on 127.0.0.1, multicast in a network namespace of its own."""

import gzip
import os
import pathlib
import shutil
import socket
import subprocess
import sys
import threading
import time
import xmlrpc.client

import pytest
from rosfleet_multimaster.edge.sockets import (
    Loop,
    Refused,
    Rpc,
    RpcServer,
    Workers,
    addresses,
    monotonic,
    notify,
    unpack,
)

NODES = pathlib.Path(__file__).parents[4] / "roles/nodes/files"


class Server:
    def __init__(self):
        self.malformed = []
        methods = {
            "add": lambda a, b: a + b,
            "big": lambda: ["x" * 100] * 100,
            "refuse": self.refuse,
            "nil": lambda: None,
            "broken": lambda: 1 / 0,
        }
        self.server = RpcServer("127.0.0.1", 0, methods, lambda host, why: self.malformed.append(why))
        self.port = self.server.server_address[1]
        self.uri = f"http://127.0.0.1:{self.port}"

    def refuse(self):
        raise Refused("no state yet")

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


@pytest.mark.parametrize("call", [("refuse",), ("unknown",), ("broken",), ("add", 1), ("system.multicall", [])])
def test_what_cannot_be_answered_is_a_fault(server, call):
    with pytest.raises(xmlrpc.client.Fault):
        Rpc(server.uri, 3.0).call(*call)
    assert server.malformed == (["broken failed: ZeroDivisionError: division by zero"] if call == ("broken",) else [])


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
    assert monotonic() - started < 0.5
    with pytest.raises(OSError):
        Rpc(other.uri, 1.0).call("add", 1, 2)


def test_a_server_that_drips_headers_is_not_waited_for():
    with socket.create_server(("127.0.0.1", 0)) as listener:

        def drip():
            connection, _address = listener.accept()
            with connection:
                connection.sendall(b"HTTP/1.0 200 OK\r\n")
                try:
                    for number in range(40):
                        connection.sendall(f"X-{number}: 1\r\n".encode())
                        time.sleep(0.1)
                except OSError:
                    pass

        threading.Thread(target=drip, daemon=True).start()
        started = monotonic()
        with pytest.raises((OSError, ValueError)):
            Rpc("http://127.0.0.1:%d" % listener.getsockname()[1], 0.5).call("getUri")
        assert monotonic() - started < 2.0


def test_a_server_that_drips_is_not_waited_for():
    with socket.create_server(("127.0.0.1", 0)) as listener:

        def drip():
            connection, _address = listener.accept()
            try:
                connection.sendall(b"HTTP/1.0 200 OK\r\n\r\n")
                while True:
                    connection.sendall(b" ")
                    time.sleep(0.05)
            except OSError:
                connection.close()

        threading.Thread(target=drip, daemon=True).start()
        started = monotonic()
        with pytest.raises(OSError, match="too slowly"):
            Rpc(f"http://127.0.0.1:{listener.getsockname()[1]}", 0.5).call("add", 1, 2)
        assert monotonic() - started < 2


@pytest.mark.parametrize("uri", ["", "x", "file:///etc/passwd", "http://", "rosrpc://a:1"])
def test_only_http_is_called(uri):
    with pytest.raises(OSError, match="no address"):
        Rpc(uri, 1.0)


def test_unpacking_is_bounded():
    assert unpack(gzip.compress(b"abc"), 3) == b"abc"
    with pytest.raises(ValueError, match="more than 2 bytes"):
        unpack(gzip.compress(b"abc"), 2)


def test_the_loop_runs_what_workers_and_threads_hand_it():
    loop, seen = Loop(), []
    workers = Workers(loop, 2)
    workers.submit(lambda: 6 * 7, lambda result, problem: seen.append((result, problem, threading.current_thread())))
    workers.submit(lambda: 1 / 0, lambda result, problem: (seen.append(type(problem)), loop.post(loop.stop)))
    loop.run(lambda now: now + 5.0)
    assert (42, None, threading.main_thread()) in seen and ZeroDivisionError in seen


def test_systemd_is_told(tmp_path, monkeypatch):
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as systemd:
        systemd.bind(str(tmp_path / "notify"))
        monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "notify"))
        notify("READY=1")
        assert systemd.recv(100) == b"READY=1"
    notify("READY=1")  # nobody listens any more: no error


def test_the_kernel_lists_the_addresses():
    found = addresses()
    assert ("127.0.0.1", socket.if_nametoindex("lo")) in found


# Multicast

IN_NAMESPACE = """
import socket, sys, time
from rosfleet_multimaster.edge.sockets import Udp, addresses
group = sys.argv[1]
pinned = Udp(group, 11511, "192.168.1.1", True)
second = Udp(group, 11511, "192.168.1.1", True)
elsewhere = Udp(group, 11511, "10.0.0.1", True)

def heard(udp, wait=0.3):
    end, found = time.monotonic() + wait, []
    while time.monotonic() < end:
        for opened in udp.sockets:
            found += udp.receive(opened)
        time.sleep(0.01)
    return [(d.data, d.source, d.multicast) for d in found]

pinned.send(b"group", None)
assert heard(pinned) == [(b"group", ("192.168.1.1", 11511), True)], "its own multicast comes back"
assert heard(second) == [(b"group", ("192.168.1.1", 11511), True)], "a second node of the computer hears it"
assert heard(elsewhere) == [], "the other interface does not"
elsewhere.send(b"other network", None)
assert heard(pinned) == [], "multicast of another interface is dropped"
assert heard(elsewhere) == [(b"other network", ("10.0.0.1", 11511), True)]
elsewhere.send(b"unicast", "10.0.0.1")
assert [(data, multicast) for data, _source, multicast in heard(elsewhere)] == [(b"unicast", False)]
try:
    Udp(group, 11511, "192.168.9.9", True)
except OSError as problem:
    assert "192.168.9.9" in str(problem)
else:
    raise AssertionError("an address that is nowhere")
"""


@pytest.mark.skipif(
    os.geteuid() != 0 or shutil.which("unshare") is None or shutil.which("ip") is None,
    reason="needs root, unshare and ip",
)
@pytest.mark.parametrize("group", ["226.0.0.0", "224.0.0.1"])
def test_multicast_stays_on_the_pinned_interface(group):
    setup = (
        "ip link set lo up && ip link add name one type veth peer name one-end && ip address add 192.168.1.1/24 dev one && ip link set one up"
        " && ip link set one-end up && ip link add name two type veth peer name two-end && ip address add 10.0.0.1/24 dev two && ip link set two up"
        ' && ip link set two-end up && exec "$@"'
    )
    command = ["unshare", "--net", "sh", "-c", setup, "sh", sys.executable, "-c", IN_NAMESPACE, group]
    done = subprocess.run(
        command,
        env={**os.environ, "PYTHONPATH": str(NODES / "python")},
        timeout=30,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
