# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The provider of a service: asked of a server that answers as roscpp and rospy do."""

import contextlib
import socket
import struct
import threading
import time

import pytest
from rosfleet_multimaster.roscore.tcpros import provider


def field(text):
    return struct.pack("<I", len(text)) + text.encode()


def header(*fields):
    body = b"".join(map(field, fields))
    return struct.pack("<I", len(body)) + body


@pytest.fixture
def server():
    """A server that gives one answer, with a pause after each byte if wanted; `asked` is what it was asked."""
    listener = socket.create_server(("127.0.0.1", 0))
    asked = []

    def start(answer, pause=0.0):
        def serve():
            connection, _address = listener.accept()
            with connection, contextlib.suppress(OSError):
                asked.append(connection.recv(10000))
                for piece in (answer[at : at + 1] for at in range(len(answer))) if pause else (answer,):
                    connection.sendall(piece)
                    time.sleep(pause)

        threading.Thread(target=serve, daemon=True).start()
        return f"rosrpc://127.0.0.1:{listener.getsockname()[1]}", asked

    yield start
    listener.close()


def test_the_answer_names_the_node(server):
    uri, asked = server(header("callerid=/a", "md5sum=1", "request_type=x"))
    assert provider(uri, "/stop", 2.0) == "/a"
    assert struct.unpack("<I", asked[0][:4])[0] == len(asked[0]) - 4
    assert field("probe=1") in asked[0] and field("md5sum=*") in asked[0] and field("service=/stop") in asked[0]


def test_an_answer_without_a_node(server):
    assert provider(server(header("error=no such service"))[0], "/stop", 2.0) == ""


@pytest.mark.parametrize("answer", [b"", b"\x01", struct.pack("<I", 100), header("a=b")[:-1]])
def test_a_connection_that_ends_early_is_no_answer(server, answer):
    with pytest.raises(OSError, match="closed"):
        provider(server(answer)[0], "/stop", 2.0)


def test_too_much_is_not_read(server):
    with pytest.raises(ValueError, match="a header of"):
        provider(server(struct.pack("<I", 1 << 30))[0], "/stop", 2.0)


def test_an_answer_that_drips_ends_at_the_time_limit(server):
    uri, asked = server(header("callerid=/a", "x=" + 200 * "y"), pause=0.05)
    began = time.monotonic()
    with pytest.raises(socket.timeout):
        provider(uri, "/stop", 0.4)
    assert asked and time.monotonic() - began < 3  # all of it would take ten seconds


@pytest.mark.parametrize("uri", ["", "http://a:1/", "rosrpc://", "rosrpc://a"])
def test_what_is_no_address(uri):
    with pytest.raises(ValueError, match="no address"):
        provider(uri, "/stop", 2.0)
