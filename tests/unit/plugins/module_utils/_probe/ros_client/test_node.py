# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The small node: as the program that a talker is, over real sockets, and beside strangers."""

import contextlib
import socket
import struct
import threading
import time
import urllib.parse
import xmlrpc.client

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.ros_client import node, tcpros
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.ros_client.header import (
    decode_fields,
    encode_header,
)
from talking import Roscore, served, talking, until

TOPIC = "/multimaster_verify/kobuki1computer"


@pytest.fixture
def own():
    """A node in a thread, which publishes one topic."""
    found = node.ProbeNode("/talker", "127.0.0.1", "http://127.0.0.1:11311", {TOPIC: "hello"})
    thread = threading.Thread(target=found.serve)
    thread.start()
    yield found
    found.ended = True
    thread.join()


def place(own):
    """The place of its topic, as it tells a subscriber."""
    code, _said, (_protocol, host, port) = xmlrpc.client.ServerProxy(own.uri).requestTopic("/x", TOPIC, [["TCPROS"]])
    assert code == 1
    return host, port


def test_a_talker_is_registered_heard_and_unregistered():
    roscore = Roscore()
    with served(roscore) as uri:
        with talking(uri, "/talker", TOPIC, "run kobuki1computer") as process:
            until(lambda: roscore.of(TOPIC))
            asked = xmlrpc.client.ServerProxy(roscore.publishers[TOPIC]["/talker"])
            assert asked.getPid("/x") == [1, "", process.pid]
            assert asked.getMasterUri("/x")[2] == uri
            assert asked.getPublications("/x")[2] == [[TOPIC, "std_msgs/String"]]
            _code, _said, (_protocol, host, port) = asked.requestTopic("/x", TOPIC, [["TCPROS"]])
            assert tcpros.hear((host, port), TOPIC, "/x") == ("run kobuki1computer", "/talker")
        assert process.returncode == 0 and roscore.of(TOPIC) == []


def test_a_talker_waits_for_its_roscore_and_says_when_it_refuses():
    roscore = Roscore()
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    with talking(f"http://127.0.0.1:{port}", "/talker", TOPIC, "x") as process:
        time.sleep(0.5)
        assert process.poll() is None
    roscore.refused = "no more topics"
    with served(roscore) as uri, talking(uri, "/talker", TOPIC, "x") as process:
        assert process.wait(10) == 1
        assert process.stdout.read().strip() == "the roscore refuses the talker: 'no more topics'"


@pytest.mark.parametrize("seconds", [0.0, 0.5])
def test_a_talker_without_an_answer_takes_its_registration_back(seconds):
    """Also where it is ended while it waits for the answer."""

    class Busy(Roscore):
        def registerPublisher(self, caller, topic, kind, uri):
            super().registerPublisher(caller, topic, kind, uri)
            time.sleep(seconds)
            raise OSError("too late")

    roscore = Busy()
    with served(roscore) as uri:
        with talking(uri, "/talker", TOPIC, "x"):
            until(lambda: roscore.of(TOPIC))
        assert roscore.of(TOPIC) == []


@pytest.mark.slow
def test_a_talker_ends_also_where_its_roscore_has_gone_silent():
    roscore = Roscore()
    roscore.unregisterPublisher = lambda *_about: time.sleep(node.FAREWELL + 3)
    with served(roscore) as uri:
        with talking(uri, "/talker", TOPIC, "x") as process:
            until(lambda: roscore.of(TOPIC))
        assert process.wait(node.FAREWELL + 2) == 0


def test_every_subscriber_gets_the_text_at_once_and_again(own):
    with socket.create_connection(place(own)) as connection:
        connection.sendall(encode_header({"callerid": "/rviz", "topic": TOPIC, "type": node.TYPE, "md5sum": node.SUM}))
        stream = connection.makefile("rb")

        def part():
            return stream.read(struct.unpack("<I", stream.read(4))[0])

        told = decode_fields(part())
        assert (told["callerid"], told["type"], told["md5sum"]) == ("/talker", node.TYPE, node.SUM)
        assert [tcpros.ValueReader(part()).text() for _number in range(2)] == ["hello", "hello"]
        entry = xmlrpc.client.ServerProxy(own.uri).getBusInfo("/x")[2][0]
        assert entry[1:6] == ["/rviz", "o", "TCPROS", TOPIC, True] and "to [127.0.0.1:" in entry[6]


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"topic": "/other", "md5sum": node.SUM}, "publishes std_msgs/String on " + TOPIC),
        ({"topic": TOPIC, "md5sum": "0" * 32}, "publishes std_msgs/String"),
    ],
)
def test_another_topic_or_type_is_refused(own, fields, words):
    with socket.create_connection(place(own)) as connection:
        connection.sendall(encode_header(fields))
        assert words in decode_fields(connection.makefile("rb").read()[4:])["error"]


STRANGE = [
    b"GET / HTTP/1.1\r\n\r\n",
    b"POST / HTTP/1.1\r\nContent-Length: 99999999\r\n\r\n",
    b"POST / HTTP/1.1\r\nContent-Length: x\r\n\r\n",
    b"POST / HTTP/1.1\r\nContent-Length: 30\r\n\r\n<!DOCTYPE a [<!ENTITY b 'c'>]>",
    b"POST / HTTP/1.1\r\nContent-Length: 5\r\n\r\n<a><b",
    b"x" * (1 << 17),
]


@pytest.mark.parametrize("said", STRANGE)
def test_a_stranger_is_let_go_and_the_others_are_served(own, said):
    for port in (int(urllib.parse.urlsplit(own.uri).port), place(own)[1]):
        with socket.create_connection(("127.0.0.1", port)) as connection:
            connection.settimeout(10)
            try:
                connection.sendall(said)
                connection.shutdown(socket.SHUT_WR)
                assert connection.recv(1 << 16) == b""
            except (ConnectionResetError, BrokenPipeError):
                pass
    assert tcpros.hear(place(own), TOPIC, "/x") == ("hello", "/talker")


def test_a_caller_that_says_nothing_is_let_go(own, monkeypatch):
    monkeypatch.setattr(node, "REQUEST", 0.2)
    with socket.create_connection(place(own)) as connection:
        connection.settimeout(10)
        assert connection.recv(1) == b""


def test_one_address_takes_not_all_places(own, monkeypatch):
    monkeypatch.setattr(node, "_OF_ONE", 3)
    there = place(own)
    with contextlib.ExitStack() as held:
        for _number in range(4):
            last = held.enter_context(socket.create_connection(there))
        other = held.enter_context(socket.create_connection(there, source_address=("127.0.0.2", 0)))
        other.settimeout(10)
        other.sendall(encode_header({"topic": TOPIC, "md5sum": "*", "callerid": "/x"}))
        last.settimeout(10)
        assert last.recv(1) == b"" and other.recv(4)


def test_an_unknown_method_is_a_fault(own):
    with pytest.raises(xmlrpc.client.Fault, match="no such method"):
        xmlrpc.client.ServerProxy(own.uri).system.listMethods()


def test_a_node_ends_when_it_is_told_to(own):
    assert xmlrpc.client.ServerProxy(own.uri).shutdown("/x", "another one has its name")[0] == 1
    until(lambda: own.ended)


@pytest.mark.parametrize(
    ("variables", "hostname", "host"),
    [
        ({"ROS_HOSTNAME": "kobuki1computer", "ROS_IP": "10.0.0.1"}, "x", "kobuki1computer"),
        ({"ROS_IP": "10.0.0.1"}, "x", "10.0.0.1"),
        ({"ROS_HOSTNAME": "localhost"}, "x", "localhost"),
        ({}, "kobuki1computer", "kobuki1computer"),
        ({}, "localhost", "127.0.0.1"),
    ],
)
def test_a_node_calls_itself_as_rosgraph_does(monkeypatch, variables, hostname, host):
    monkeypatch.setattr(node.socket, "gethostname", lambda: hostname)
    assert node.host_of(variables, "http://127.0.0.1:11311/") == host


def stream(own, seconds, name="/x"):
    return tcpros.send_stream(place(own), TOPIC, name, seconds)


def test_a_stream_is_counted_where_it_comes_and_is_bounded(own, monkeypatch):
    began = time.monotonic()
    came, took = stream(own, 0.2)
    assert time.monotonic() - began < 5 and took > 0
    assert came >= node.STREAM_BYTES or 0.2 <= took < 2
    monkeypatch.setattr(node, "STREAM_BYTES", 100_000)
    came, took = stream(own, 2.0)
    assert 100_000 <= came < 300_000 and took < 2.0
    assert tcpros.hear(place(own), TOPIC, "/x") == ("hello", "/talker")


def test_a_stream_is_no_longer_than_the_talker_allows(own, monkeypatch):
    monkeypatch.setattr(node, "STREAM", 0.1)
    monkeypatch.setattr(node, "STREAM_BYTES", 1 << 40)
    monkeypatch.setattr(tcpros.node, "STREAM_BYTES", 1 << 40)
    assert stream(own, 3600.0)[1] < 2.0


def opened(own, seconds):
    """A stream that has begun: its connection, and what the talker said."""
    connection = socket.create_connection(place(own))
    connection.sendall(encode_header({"callerid": "/y", "topic": TOPIC, "md5sum": node.SUM, "stream": seconds}))
    size = struct.unpack("<I", connection.recv(4, socket.MSG_WAITALL))[0]
    return connection, decode_fields(connection.recv(size, socket.MSG_WAITALL))


def test_a_second_stream_is_refused_until_the_first_ends(own):
    connection, told = opened(own, "1")
    with connection:
        assert told["stream"] == "1"
        with pytest.raises(OSError, match="it takes another stream"):
            stream(own, 0.1)
    until(lambda: not any(link.stream for link in own._links))
    assert stream(own, 0.1)[0] > 0


@pytest.mark.slow
@pytest.mark.parametrize("seconds", ["x", "", "nan", "-1", "1e999"])
def test_whatever_length_a_stranger_asks_for_the_talker_stays(own, seconds, monkeypatch):
    monkeypatch.setattr(node, "REQUEST", 0.3)
    try:
        connection, _told = opened(own, seconds)
        with connection:
            connection.settimeout(10)
            while connection.recv(1 << 16):
                pass
    except (struct.error, ConnectionResetError):
        pass
    assert tcpros.hear(place(own), TOPIC, "/x") == ("hello", "/talker")


def test_one_who_is_no_talker_of_this_run_takes_no_stream():
    with socket.create_server(("127.0.0.1", 0)) as door:
        thread = threading.Thread(target=lambda: door.accept()[0].sendall(encode_header({"topic": TOPIC})))
        thread.start()
        with pytest.raises(OSError, match="it takes no stream"):
            tcpros.send_stream(door.getsockname(), TOPIC, "/x", 0.1)
        thread.join()


@pytest.mark.parametrize("said", ["-5 1", "5 0", "5", "x y", "5 nan", "9 1e-320", "99999999999 1"])
def test_a_number_that_cannot_be_is_a_sentence(said):
    def answer(door):
        connection = door.accept()[0]
        connection.recv(1 << 16)
        connection.sendall(encode_header({"stream": "0.1"}) + node.message(said))
        with contextlib.suppress(ConnectionResetError):
            connection.recv(1)

    with socket.create_server(("127.0.0.1", 0)) as door:
        thread = threading.Thread(target=answer, args=(door,), daemon=True)
        thread.start()
        with pytest.raises(OSError, match="an answer that is none"):
            tcpros.send_stream(door.getsockname(), TOPIC, "/x", 0.1)
