# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""A small ROS node in one loop, without ROS: the slave API, and topics whose text each subscriber gets at once and every second.

The talker is this file as a program of its own, handed over as text with header.py (../measure/talker.py). So nothing else of the
collection may be imported here.
Any program may call: bytes, connections and time are bounded.
"""

import contextlib
import os
import selectors
import signal
import socket
import struct
import sys
import time
import typing
import xmlrpc.client

from .header import decode_fields, encode_block, encode_header

TYPE, SUM = "std_msgs/String", "992ce8a1687cec8c8bd883ec73ca41d1"
DEFINITION = "string data\n"
PERIOD = 1.0  # seconds between two messages
REQUEST = 10.0  # seconds that a caller has for its question, and for its answer
FAREWELL = 3.0  # seconds for taking a registration back: a roscore that has the question does so without us
RETRY = 0.5  # seconds until a roscore that does not answer is asked again
STREAM, STREAM_BYTES = 2.0, 20_000_000  # seconds and bytes of a stream that measures the throughput
_BYTES = 1 << 16  # of a question
_CONNECTIONS, _OF_ONE = 900, 100  # at once, and from one address; a process may have 1,024 files


def host_of(variables: typing.Mapping[str, str], uri: str) -> str:
    """Return the host by which a node of this computer calls itself, as rosgraph.network does; `uri` is that of its roscore."""
    chosen = variables.get("ROS_HOSTNAME") or variables.get("ROS_IP")
    named = chosen or socket.gethostname()
    if chosen or not (named == "localhost" or named.startswith("127.")):
        return named
    place = uri.split("://")[-1].split("/")[0]
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as asked:  # nothing is sent
        asked.connect((place.split(":")[0], 9))
        return str(asked.getsockname()[0])


def message(text: str) -> bytes:
    """A std_msgs/String with its length before it."""
    return encode_block(encode_block(text.encode()))


class _Stream:
    """The part of a stream that has come, since its first piece."""

    def __init__(self, seconds: float) -> None:
        self.seconds = min(seconds, STREAM)
        self.began: typing.Optional[float] = None
        self.bytes = 0

    def took(self, size: int) -> typing.Optional[str]:
        """Count a piece; at the end return the sum: bytes and seconds."""
        now = time.monotonic()
        if self.began is None:
            self.began = now  # the first piece was under way for an unknown time
            return None
        self.bytes += size
        if now - self.began < self.seconds and self.bytes < STREAM_BYTES:
            return None
        return f"{self.bytes} {now - self.began:.6f}"


class _Link:
    """A connection: of a caller until its question is answered, of a subscriber, or of the sender of a stream."""

    def __init__(self, connection: socket.socket, address: str, answer: typing.Callable[["_Link"], None]) -> None:
        self.connection, self.address, self.answer = connection, address, answer
        self.read, self.written = b"", b""
        self.topic, self.name = "", ""  # of a subscriber
        self.stream: typing.Optional[_Stream] = None
        self.last = False  # it ends when all is written
        self.deadline: typing.Optional[float] = time.monotonic() + REQUEST


class ProbeNode:
    """A node with its sockets. `announced` is called with the name of a topic and its publishers when the roscore sends them."""

    def __init__(
        self,
        name: str,
        host: str,
        master: str,
        topics: typing.Mapping[str, str],
        announced: typing.Callable[[str, typing.List[str]], None] = lambda topic, publishers: None,
    ) -> None:
        """Open the sockets; `topics` are {published topic: its text}. Raises OSError."""
        self.name, self.host, self.master, self.topics, self.announced = name, host, master, topics, announced
        self.ended = False
        self._links: typing.Set[_Link] = set()
        self._selector = selectors.DefaultSelector()
        bind_address = "127.0.0.1" if host == "localhost" or host.startswith("127.") else ""
        self._ports = [self._open(bind_address, answer) for answer in (self._answer_call, self._answer_subscriber)]
        self.uri = f"http://{host}:{self._ports[0]}/"

    def _open(self, address: str, answer: typing.Callable[[_Link], None]) -> int:
        door = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        door.setblocking(False)
        door.bind((address, 0))
        door.listen(128)
        self._selector.register(door, selectors.EVENT_READ, answer)
        return int(door.getsockname()[1])

    def serve(self) -> None:
        """Answer until `ended`; it may be set by another thread, and counts within a tenth of a second."""
        spoken = time.monotonic()
        try:
            while not self.ended or any(link.last for link in self._links):  # a caller gets the whole answer
                for key, _events in self._selector.select(0.1):
                    if isinstance(key.data, _Link):
                        self._move(key.data)
                    else:
                        self._accept(typing.cast(socket.socket, key.fileobj), key.data)
                now = time.monotonic()
                if now - spoken >= PERIOD:
                    spoken = now
                    self._speak(now)
        finally:
            for key in list(self._selector.get_map().values()):
                typing.cast(socket.socket, key.fileobj).close()
            self._selector.close()

    # Connections

    def _accept(self, door: socket.socket, answer: typing.Callable[[_Link], None]) -> None:
        try:
            connection, (address, _port) = door.accept()
        except OSError:  # it has ended since
            return
        of_one = sum(link.address == address for link in self._links)
        if len(self._links) >= _CONNECTIONS or of_one >= _OF_ONE:
            connection.close()
            return
        connection.setblocking(False)
        link = _Link(connection, address, answer)
        self._links.add(link)
        self._selector.register(connection, selectors.EVENT_READ, link)

    def _move(self, link: _Link) -> None:
        """Read the bytes that have come, answer a question that is whole, write the bytes that are due."""
        try:
            if link.written:
                self._write(link)
            else:
                piece = link.connection.recv(_BYTES)
                link.read = piece if link.stream else link.read + piece
                if not piece or len(link.read) > _BYTES:
                    self._leave(link)
                elif link.stream:
                    came = link.stream.took(len(piece))
                    if came is not None:
                        self._say(link, message(came), True)
                elif link.topic:
                    link.read = b""  # a subscriber says nothing after its header
                else:
                    link.answer(link)
        except BlockingIOError:
            pass
        except Exception:  # whatever a stranger makes of it
            self._leave(link)

    def _write(self, link: _Link) -> None:
        link.written = link.written[link.connection.send(link.written) :]
        if link.last and not link.written:
            self._leave(link)
        else:
            events = selectors.EVENT_WRITE if link.written else selectors.EVENT_READ
            self._selector.modify(link.connection, events, link)

    def _say(self, link: _Link, data: bytes, last: bool = False) -> None:
        link.written, link.last = data, last
        self._selector.modify(link.connection, selectors.EVENT_WRITE, link)

    def _leave(self, link: _Link) -> None:
        if link in self._links:
            self._links.remove(link)
            self._selector.unregister(link.connection)
            link.connection.close()

    def _speak(self, now: float) -> None:
        """Say the texts again, and close connections that are late."""
        for link in list(self._links):
            if link.topic and not link.written:
                self._say(link, message(self.topics[link.topic]))
            elif link.deadline is not None and now > link.deadline:
                self._leave(link)

    # Subscribers: http://wiki.ros.org/ROS/TCPROS

    def _answer_subscriber(self, link: _Link) -> None:
        size = struct.unpack("<I", link.read[:4])[0] if len(link.read) >= 4 else 0
        if len(link.read) < 4 or len(link.read) < 4 + size:
            return
        asked = decode_fields(link.read[4 : 4 + size], "replace")
        topic, link.read = asked.get("topic", ""), b""
        if topic not in self.topics or asked.get("md5sum") not in (SUM, "*"):
            self._say(
                link,
                encode_header({"error": "this node publishes {} on {}".format(TYPE, ", ".join(self.topics))}),
                True,
            )
            return
        if "stream" in asked:
            self._begin(link, topic, float(asked["stream"]))
            return
        link.topic, link.name, link.deadline = topic, asked.get("callerid", ""), None
        fields = {"callerid": self.name, "topic": topic, "type": TYPE, "md5sum": SUM, "latching": "0"}
        self._say(link, encode_header(dict(fields, message_definition=DEFINITION)) + message(self.topics[topic]))

    # Streams: a subscriber of this verification sends for a moment, and gets the number of bytes that came

    def _begin(self, link: _Link, topic: str, seconds: float) -> None:
        """Take a stream, one at a time: two would measure each other."""
        if any(other.stream for other in self._links):
            self._say(link, encode_header({"error": "it takes another stream"}), True)
            return
        link.stream, link.deadline = _Stream(seconds), time.monotonic() + REQUEST
        self._say(link, encode_header({"callerid": self.name, "topic": topic, "stream": f"{link.stream.seconds:g}"}))

    # Callers: http://wiki.ros.org/ROS/Slave_API

    def _answer_call(self, link: _Link) -> None:
        head, end, body = link.read.partition(b"\r\n\r\n")
        if not end:
            return
        lines = [line.split(b":", 1) for line in head.lower().split(b"\r\n")[1:]]
        length = int(dict(line for line in lines if len(line) == 2).get(b"content-length", b"0"))
        if not 0 < length <= _BYTES:
            raise ValueError("a question without a length")
        if len(body) < length:
            return
        answer = self._answer(body[:length]).encode()
        begin = f"HTTP/1.0 200 OK\r\nContent-Type: text/xml\r\nContent-Length: {len(answer)}\r\n\r\n"
        self._say(link, begin.encode() + answer, True)

    def _answer(self, body: bytes) -> str:
        if b"<!" in body:  # no document of XML-RPC needs a document type
            raise ValueError("a document type")
        arguments, method = xmlrpc.client.loads(body.decode())
        if method not in ANSWERS:
            return xmlrpc.client.dumps(xmlrpc.client.Fault(1, "no such method"), allow_none=True)
        return xmlrpc.client.dumps((ANSWERS[method](self, *arguments[1:]),), methodresponse=True)

    def ask_for_topic(self, topic: str, _protocols: typing.Any) -> typing.List[typing.Any]:
        """Give the port of a topic."""
        if topic not in self.topics:
            return [0, "not published here", 0]
        return [1, "ready", ["TCPROS", self.host, self._ports[1]]]

    def take_publishers(self, topic: str, publishers: typing.List[str]) -> typing.List[typing.Any]:
        """Take the publishers of a topic from the roscore."""
        self.announced(str(topic), [str(uri) for uri in publishers])
        return [1, "taken", 0]

    def end(self, _reason: str = "") -> typing.List[typing.Any]:
        """End, as a node does when another node takes its name."""
        self.ended = True
        return [1, "it ends", 0]

    def bus(self) -> typing.List[typing.Any]:
        """List the connections with subscribers, in the words of rospy."""
        connections: typing.List[typing.Any] = []
        for link in self._links:
            if link.topic:
                place = "{}:{} on socket {}".format(*link.connection.getpeername()[:2], link.connection.fileno())
                words = f"TCPROS connection on port {self._ports[1]} to [{place}]"
                connections.append([len(connections), link.name, "o", "TCPROS", link.topic, True, words])
        return connections


# method -> its answer, without the name of the caller
ANSWERS: typing.Dict[str, typing.Callable[..., typing.List[typing.Any]]] = {
    "getPid": lambda node: [1, "", os.getpid()],
    "getMasterUri": lambda node: [1, "", node.master],
    "getBusInfo": lambda node: [1, "", node.bus()],
    "getBusStats": lambda node: [1, "", [[], [], []]],
    "getPublications": lambda node: [1, "", [[topic, TYPE] for topic in node.topics]],
    "getSubscriptions": lambda node: [1, "", []],
    "paramUpdate": lambda node, key, value: [0, "no parameter is read", 0],
    "publisherUpdate": ProbeNode.take_publishers,
    "requestTopic": ProbeNode.ask_for_topic,
    "shutdown": ProbeNode.end,
}


def _leave(*_signal: typing.Any) -> None:
    raise SystemExit


def main(name: str, topic: str, text: str) -> None:
    """Publish a text on a topic until a signal comes; a roscore that does not answer yet is waited for."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, _leave)
    socket.setdefaulttimeout(REQUEST)
    uri = os.environ["ROS_MASTER_URI"]
    node = ProbeNode(name, host_of(os.environ, uri), uri, {topic: text})
    roscore = xmlrpc.client.ServerProxy(uri)
    try:
        while not _register(roscore, name, topic, node.uri):
            time.sleep(RETRY)
        node.serve()
    finally:
        # By a connection of its own: the signal may have come while the other one waited for an answer.
        socket.setdefaulttimeout(FAREWELL)
        with contextlib.suppress(OSError, xmlrpc.client.Error):
            xmlrpc.client.ServerProxy(uri).unregisterPublisher(name, topic, node.uri)


def _register(roscore: typing.Any, name: str, topic: str, uri: str) -> bool:
    try:
        code, said, _publishers = roscore.registerPublisher(name, topic, TYPE, uri)
    except (OSError, xmlrpc.client.Error):
        return False
    if code != 1:
        raise SystemExit(f"the roscore refuses the talker: {ascii(said)[:200]}")
    return True


def _program() -> None:
    """Run it, and end with one line of the journal if it cannot go on: a traceback would have foreign text in it."""
    try:
        main(*sys.argv[1:])
    except Exception as problem:
        raise SystemExit(f"the talker cannot go on: {ascii(problem)[:200]}") from None


if __name__ == "__main__":
    _program()
