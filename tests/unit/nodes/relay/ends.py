# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The ends of connections of TCPROS, as nodes have them: publishers and listeners with real sockets."""

import contextlib
import random
import socket
import struct

from rosfleet_multimaster.protocol.tcpros.header import decode_header, encode_header
from rosfleet_multimaster.protocol.tcpros.messages import MessageReader

SUM = "a" * 32
HEADER = {
    "callerid": "/talker",
    "topic": "/chatter",
    "type": "std_msgs/String",
    "md5sum": SUM,
    "message_definition": "string data",
}


def free_port():
    """A port that no connection of this machine gets by chance, so a program can have it again (ip_local_port_range of ip(7))."""
    while True:
        port = random.randrange(15000, 30000)
        with contextlib.suppress(OSError), socket.create_server(("127.0.0.1", port)):
            return port


def message(body):
    return struct.pack("<I", len(body)) + body


def text(value):
    return struct.pack("<I", len(value)) + value


def tree(*pairs):
    """The body of a message of tf: transforms between these frames."""
    head, pose = struct.pack("<3I", 1, 2, 3), struct.pack("<7d", 1, 2, 3, 0, 0, 0, 1)
    return struct.pack("<I", len(pairs)) + b"".join(head + text(one) + text(other) + pose for one, other in pairs)


LINE = "=" * 80
#: a type in which a text of four bytes is many steps
DEEP = f"\n{LINE}\n".join(
    ["D1[] all"] + [f"MSG: x/D{number}\nD{number + 1} a" for number in range(1, 27)] + ["MSG: x/D27\nstring frame_id"]
)
#: many messages of it: of 8 bytes, 4 kB and 100 kB
DEAR = {
    f"{texts} texts": message(struct.pack("<I", texts) + bytes(4 * texts)) * (1 + 60_000 // texts)
    for texts in (1, 1000, 25_000)
}


class End:
    """One end of a connection, as a node has it."""

    def __init__(self, connection, most=1 << 24):
        self.connection, self.reader, self.came = connection, MessageReader(most), []
        connection.settimeout(10)

    def say(self, data):
        self.connection.sendall(data)

    def next(self):
        while not self.came:
            data = self.connection.recv(1 << 16)
            if not data:
                raise EOFError
            self.reader.feed(data)
            self.came += iter(self.reader.take, None)
        return self.came.pop(0)

    def header(self):
        return decode_header(self.next())

    def close(self):
        self.connection.close()


class Publisher:
    """A publisher's port."""

    def __init__(self):
        self.server = socket.create_server(("127.0.0.1", 0))
        self.server.settimeout(10)
        self.place = self.server.getsockname()

    def dial(self):
        return socket.create_connection(self.place, 5)

    def accept(self, **changed):
        end = End(self.server.accept()[0])
        end.asked = end.header()
        end.say(encode_header({**HEADER, **changed}))
        return end
