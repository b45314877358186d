# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Calls at servers that answer slowly or are none, on 127.0.0.1."""

import socket
import threading
import time
from socketserver import ThreadingMixIn
from xmlrpc.server import SimpleXMLRPCRequestHandler, SimpleXMLRPCServer

import pytest
from rosfleet_multimaster.edge import rpc_client as module
from rosfleet_multimaster.edge.clock import monotonic
from rosfleet_multimaster.edge.rpc_client import SAME, Last, Rpc
from rosfleet_multimaster.protocol.xml_rpc import loads


def test_a_server_that_drips_headers_is_not_waited_for():
    with socket.create_server(("127.0.0.1", 0)) as listener:

        def drip():
            connection, _address = listener.accept()
            with connection:
                connection.sendall(b"HTTP/1.0 200 OK\r\n")
                try:
                    for number in range(400):
                        connection.sendall(f"X-{number}: 1\r\n".encode())
                        time.sleep(0.1)
                except OSError:
                    pass

        threading.Thread(target=drip, daemon=True).start()
        started = monotonic()
        with pytest.raises((OSError, ValueError)):
            Rpc(f"http://127.0.0.1:{listener.getsockname()[1]}", 0.5).call("getUri")
        assert monotonic() - started < 15.0


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
        assert monotonic() - started < 15


@pytest.mark.parametrize("uri", ["", "x", "file:///etc/passwd", "http://", "rosrpc://a:1"])
def test_only_http_is_called(uri):
    with pytest.raises(OSError, match="no address"):
        Rpc(uri, 1.0)


def test_a_connection_that_the_other_side_keeps_is_used_again():
    class Kept(SimpleXMLRPCRequestHandler):
        protocol_version = "HTTP/1.1"

    class Server(ThreadingMixIn, SimpleXMLRPCServer):
        daemon_threads, block_on_close, taken = True, False, 0

        def verify_request(self, request, client_address):
            self.taken += 1
            return True

    with Server(("127.0.0.1", 0), Kept, logRequests=False) as server:
        server.register_function(lambda size: "x" * size, "big")
        threading.Thread(target=server.serve_forever, args=(0.05,), daemon=True).start()
        rpc = Rpc(f"http://127.0.0.1:{server.server_address[1]}", 5.0, 1 << 20)
        assert [len(rpc.call("big", size)) for size in (1, 100_000, 0)] == [1, 100_000, 0]
        assert server.taken == 1
        rpc.close()
        server.shutdown()


def test_an_answer_that_is_the_last_one_again_is_not_read(monkeypatch):
    reads, told = [], ["one"]
    monkeypatch.setattr(module, "loads", lambda *answer: reads.append(1) or loads(*answer))
    with SimpleXMLRPCServer(("127.0.0.1", 0), logRequests=False) as server:
        server.register_function(lambda *_about: told[0], "get")
        server.register_function(lambda *_about: told[0], "other")
        server.register_multicall_functions()
        threading.Thread(target=server.serve_forever, args=(0.05,), daemon=True).start()
        rpc, last = Rpc(f"http://127.0.0.1:{server.server_address[1]}", 5.0), Last()
        assert [rpc.call("get", last=last) for _time in range(2)] == ["one", SAME] and len(reads) == 1
        assert rpc.call("other", last=last) == "one", "the answer to another question"
        assert rpc.call("other", "more", last=last) == "one"
        assert rpc.multicall([("get",), ("other",)], last) == ["one", "one"]
        assert rpc.multicall([("get",), ("other",)], last) == []
        told[0] = "two"
        assert rpc.multicall([("get",), ("other",)], last) == ["two", "two"]
        server.shutdown()
