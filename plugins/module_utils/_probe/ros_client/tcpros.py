# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""Services of discovery and sync nodes, and topics, by their own protocol (http://wiki.ros.org/ROS/TCPROS), without ROS here.

Any program may answer: time, bytes and numbers of entries are bounded.
"""

import contextlib
import os
import selectors
import socket
import struct
import time
import typing

from ..._base.deadlines import stretch
from ..._base.plain_text import plain, quote
from . import node
from .header import decode_fields, encode_block, encode_header
from .hosts import place_of
from .xml_rpc import ask

CALL = 5.0  # seconds that a call may take at the usual pace, from the connection to the last byte
CONNECT = 2.0  # seconds that a connection may take before a stream
LEAST = 1e-6  # seconds of a stream: of much fewer, the rate would be infinite
MOST = 2 << 20  # bytes of an answer: 5,000 topics are 1 MB
_HEADER = 1 << 14  # bytes of a header
_DEFINITIONS = 1 << 20  # of one with the definition of a message of any type
SILENCE = 1.0  # seconds that a message is waited for, where one need not come
_ENTRIES = 50000  # of all lists of an answer

Row = typing.Dict[str, typing.Any]


class ValueReader:
    """The values of a message, one after the other. Raises ValueError if the bytes have another form."""

    def __init__(self, data: bytes) -> None:
        self._data, self._at, self._entries = data, 0, 0

    def number(self) -> int:
        """A uint32."""
        return struct.unpack("<I", self._take(4))[0]

    def flag(self) -> bool:
        """A bool."""
        return self._take(1) != b"\0"

    def text(self) -> str:
        """A string."""
        return self._take(self.number()).decode("utf-8", "replace")

    def texts(self, *names: str) -> Row:
        """Strings, by these names."""
        return {name: self.text() for name in names}

    def items(self, read: typing.Callable[["ValueReader"], typing.Any]) -> typing.List[typing.Any]:
        """A list of values that `read` reads."""
        count = self.number()
        self._entries += count
        if self._entries > _ENTRIES:
            raise ValueError(f"more than {_ENTRIES} entries")
        return [read(self) for unused in range(count)]

    def _take(self, size: int) -> bytes:
        end = self._at + size
        if end > len(self._data):
            raise ValueError("its end is missing")
        piece, self._at = self._data[self._at : end], end
        return piece


def _master(reader: ValueReader) -> Row:
    """fkie_multimaster_msgs/ROSMaster."""
    name, uri = reader.text(), reader.text()
    for unused in range(4):  # two times of 8 bytes: numbers before 1.1, times of ROS since
        reader.number()
    return {
        "name": plain(name),
        "uri": plain(uri),
        "online": reader.flag(),
        "discoverer_name": plain(reader.text()),
        "monitoruri": plain(reader.text()),
    }


def _topic(reader: ValueReader) -> Row:
    """fkie_multimaster_msgs/SyncTopicInfo."""
    return reader.texts("topic", "node", "nodeuri")


def _service(reader: ValueReader) -> Row:
    """fkie_multimaster_msgs/SyncServiceInfo."""
    return reader.texts("service", "serviceuri", "node", "nodeuri")


def _sync_master(reader: ValueReader) -> Row:
    """fkie_multimaster_msgs/SyncMasterInfo."""
    return {
        "masteruri": reader.text(),
        "nodes": reader.items(ValueReader.text),
        "publisher": reader.items(_topic),
        "subscriber": reader.items(_topic),
        "services": reader.items(_service),
    }


Types = typing.Mapping[str, typing.Callable[[ValueReader], Row]]

# md5 sum of a service -> how an entry of its answer is read; both services answer with one list, and ask nothing.
# Upstream's from 0.3.6 on, which is older than all that run on computers of the modules.
LIST_MASTERS = {
    "31a962d97ea3e3c12d428ff4786f124b": _master,  # since 1.1.0
    "bc7525cc24dd3b880f044a2cdfb95aad": _master,  # before, as on Melodic
}
GET_SYNC_INFO = {"d5261ec56e202860a07fb47b41e1b2a8": _sync_master}


@contextlib.contextmanager
def _explain(late: str, strange: str) -> typing.Iterator[None]:
    """Raise OSError with one of these sentences for an answer that does not come, or that has another form."""
    try:
        yield
    except socket.timeout:
        raise socket.timeout(late) from None
    except (ValueError, struct.error) as problem:  # also for a text that is no URI
        raise OSError(f"{strange}: {quote(problem)}") from None


def call(uri: str, service: str, known: Types, caller: str) -> typing.Tuple[typing.List[Row], str]:
    """Call a service at its URI (rosrpc://host:port); return the list in its answer, and its type. Raises OSError with a sentence."""
    limit = stretch(CALL)
    deadline = time.monotonic() + limit
    with _explain(f"{service} gave no answer within {limit:g} s", f"{service} gave an answer that is none"):
        host, port = place_of(uri)
        if not uri.startswith("rosrpc:") or not host or not port:
            raise ValueError(f"{quote(uri)} is no address of a service")
        with socket.create_connection((host, port), limit) as connection:
            connection.sendall(encode_header({"callerid": caller, "service": service, "md5sum": "*"}))
            fields = decode_fields(_read_block(connection, _HEADER, deadline), "replace")
            if "error" in fields:
                raise OSError(f"{service}: {quote(fields['error'])}")
            if fields.get("md5sum") not in known:
                raise OSError(
                    f"{service} is of the type {quote(fields.get('type', ''))} ({quote(fields.get('md5sum', ''))}), which is not known"
                )
            connection.sendall(encode_block(b""))
            good = _read(connection, 1, deadline) == b"\1"
            answer = _read_block(connection, MOST, deadline)
        if not good:
            raise OSError(f"{service}: {quote(answer.decode('utf-8', 'replace'))}")
        return ValueReader(answer).items(known[fields["md5sum"]]), plain(fields.get("type", ""))


def call_by_name(master: str, service: str, known: Types, caller: str) -> typing.Tuple[typing.List[Row], str]:
    """Call a service at the address that the roscore at `master` gives. Returns and raises as `call` does."""
    return call(str(ask(master, caller, "lookupService", service)), service, known, caller)


def hear(
    place: typing.Tuple[str, int], topic: str, caller: str, on_open: typing.Callable[[], None] = lambda: None
) -> typing.Tuple[str, str]:
    """Subscribe a topic of texts at its publisher, and return its next message, and its node. Raises OSError with a sentence.

    `on_open` is called when the connection is open.
    """
    limit = stretch(CALL)
    deadline = time.monotonic() + limit
    late, strange = f"no message within {limit:g} s", "a message that is none"
    with _explain(late, strange), socket.create_connection(place, limit) as connection:
        on_open()
        fields = _subscribe(connection, topic, caller, deadline, tcp_nodelay="1")
        return plain(ValueReader(_read_block(connection, _HEADER, deadline)).text()), plain(fields.get("callerid", ""))


def hear_any(place: typing.Tuple[str, int], asked: typing.Mapping[str, str]) -> bool:
    """Subscribe a topic of any type; return True if a message begins within a second after the header of the publisher.

    `asked`: the fields that say which topic. The message is not read. Raises OSError with a sentence where no header comes.
    """
    limit = stretch(CALL)
    deadline = time.monotonic() + limit
    late, strange = f"no header of a publisher within {limit:g} s", "a header that is none"
    with _explain(late, strange), socket.create_connection(place, limit) as connection:
        connection.sendall(encode_header({"type": "*", "md5sum": "*", "tcp_nodelay": "1", **asked}))
        fields = decode_fields(_read_block(connection, _DEFINITIONS, deadline), "replace")
        if "error" in fields or not fields.get("md5sum"):
            raise OSError(plain(fields.get("error", "")) or "a header without md5sum")
        try:
            return bool(_read(connection, 4, time.monotonic() + SILENCE))
        except (OSError, ValueError):  # nothing was said, or it has ended since
            return False


def send_stream(place: typing.Tuple[str, int], topic: str, caller: str, seconds: float) -> typing.Tuple[int, float]:
    """Send to a talker as fast as it takes it; return the bytes that came there, and in how many seconds.

    Raises OSError with a sentence.
    """
    limit = stretch(CALL)
    deadline = time.monotonic() + limit + seconds
    late, strange = f"no answer within {limit:g} s", "an answer that is none"
    with _explain(late, strange), socket.create_connection(place, stretch(CONNECT)) as connection:
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))  # the rest is not sent
        if "stream" not in _subscribe(connection, topic, caller, deadline, stream=f"{seconds:g}"):
            raise OSError("it takes no stream")
        _send(connection, deadline)
        came, took = ValueReader(_read_block(connection, _HEADER, deadline)).text().split()
        if not 0 < int(came) <= 2 * node.STREAM_BYTES or not LEAST <= float(took) <= node.REQUEST:
            raise ValueError(f"{quote(came)} bytes in {quote(took)} s")
        return int(came), float(took)


def _subscribe(
    connection: socket.socket, topic: str, caller: str, deadline: float, **more: str
) -> typing.Dict[str, str]:
    """Subscribe a topic of texts; return the header of the answer. Raises OSError with the publisher's words if it refuses."""
    asked = {"callerid": caller, "topic": topic, "type": node.TYPE, "md5sum": node.SUM, **more}
    connection.sendall(encode_header(asked))
    fields = decode_fields(_read_block(connection, _HEADER, deadline), "replace")
    if "error" in fields:
        raise OSError(plain(fields["error"]))
    return fields


def _send(connection: socket.socket, deadline: float) -> None:
    """Send until there is an answer."""
    piece = os.urandom(1 << 16)  # random bytes, which no link can compress
    with selectors.DefaultSelector() as selector:
        selector.register(connection, selectors.EVENT_READ | selectors.EVENT_WRITE)
        while time.monotonic() < deadline:
            events = [event for _key, event in selector.select(deadline - time.monotonic())]
            if any(event & selectors.EVENT_READ for event in events):
                return
            try:
                if events:
                    connection.send(piece)
            except OSError:  # it has answered and gone; the answer is there to be read
                return
    raise socket.timeout


def _read_block(connection: socket.socket, most: int, deadline: float) -> bytes:
    (size,) = struct.unpack("<I", _read(connection, 4, deadline))
    if size > most:
        raise ValueError(f"it has {size} bytes")
    return _read(connection, size, deadline)


def _read(connection: socket.socket, size: int, deadline: float) -> bytes:
    data = bytearray()
    while len(data) < size:
        left = deadline - time.monotonic()
        if left <= 0:
            raise socket.timeout
        connection.settimeout(left)
        piece = connection.recv(min(size - len(data), 1 << 16))
        if not piece:
            raise ValueError("the connection was closed")
        data += piece
    return bytes(data)
