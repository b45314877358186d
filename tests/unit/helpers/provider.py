# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""A provider of a ROS service over a real socket, as far as TCPROS goes; what it answers is given."""

import contextlib
import socket
import struct
import threading

LIST_MASTERS, GET_SYNC_INFO = "31a962d97ea3e3c12d428ff4786f124b", "d5261ec56e202860a07fb47b41e1b2a8"


def block(content):
    return struct.pack("<I", len(content)) + content


def head(**fields):
    return block(b"".join(block(f"{name}={value}".encode()) for name, value in fields.items()))


def text(value):
    return block(value.encode())


def rows(*entries):
    return struct.pack("<I", len(entries)) + b"".join(entries)


def master(name, uri="", online=True, monitor=""):
    return text(name) + text(uri) + bytes(16) + bytes([online]) + text("/master_discovery") + text(monitor)


def synced(uri, node, nodeuri):
    topic = text("/odom") + text(node) + text(nodeuri)
    service = text("/plan") + text("rosrpc://x:1") + text(node) + text(nodeuri)
    return text(uri) + rows() + rows(topic) + rows(topic) + rows(service)


def answer(content, good=True):
    return bytes([good]) + block(content)


@contextlib.contextmanager
def provider(first, second=b"", asked=None):
    """The URI of a service that sends `first` after the header of a caller, and `second` after its question."""
    listening = socket.create_server(("127.0.0.1", 0))

    def serve():
        while True:
            try:
                connection, _address = listening.accept()
            except OSError:
                return
            with connection, contextlib.suppress(OSError):
                received = connection.recv(1 << 16)
                if asked is not None:
                    asked.append(received)
                connection.sendall(first)
                if connection.recv(4) == bytes(4):
                    connection.sendall(second)
                connection.recv(1)  # until the caller has gone

    thread = threading.Thread(target=serve, daemon=True)
    thread.start()
    try:
        yield f"rosrpc://127.0.0.1:{listening.getsockname()[1]}"
    finally:
        listening.shutdown(socket.SHUT_RDWR)
        listening.close()
        thread.join(10)
