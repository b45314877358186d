# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Calls at servers that answer slowly or are none, on 127.0.0.1."""

import socket
import threading
import time

import pytest
from rosfleet_multimaster.edge.clock import monotonic
from rosfleet_multimaster.edge.rpc_client import Rpc


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
