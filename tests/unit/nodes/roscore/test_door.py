# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The door of the roscore, with real connections: what ordinary clients send is taken, and what is beyond a bound is answered."""

import gzip
import http.client
import socket
import socketserver
import threading
import time
import xmlrpc.client

import pytest
from rosfleet_multimaster.edge.core.shares import Shares
from rosfleet_multimaster.edge.process import throttle
from rosfleet_multimaster.edge.process.room import NoRoom, Room
from rosfleet_multimaster.edge.process.throttle import Throttle
from rosfleet_multimaster.roscore import door
from rosfleet_multimaster.roscore.core import bounds
from rosfleet_multimaster.roscore.core.bounds import BOUNDS


class Server(socketserver.ThreadingMixIn, socketserver.TCPServer):
    """As roscore/master.py makes it of rosgraph's."""

    allow_reuse_address = daemon_threads = True

    def __init__(self):
        self.calls, self.refused, self.broken = threading.local(), [], []
        self.door = door.Door(self.answer, lambda problem: self.refused.append(problem.bound), self.calls)
        handler = type("Handler", (door.Handler,), {"door": self.door, "protocol_version": "HTTP/1.1"})
        super().__init__(("127.0.0.1", 0), handler)
        self.uri = "http://127.0.0.1:%d/" % self.server_address[1]
        threading.Thread(target=self.serve_forever, kwargs={"poll_interval": 0.05}, daemon=True).start()

    def answer(self, name, arguments):
        if name == "system.multicall":
            return door.multicall(self.answer, *arguments, self.calls.caller.pause)
        if name == "work":
            end = time.thread_time() + arguments[0]
            while time.thread_time() < end:
                pass
            return [1, "", 0]
        if name == "echo":
            return [1, "", *arguments]
        if name == "many":
            return [1, "", ["x" * arguments[0]] * arguments[1]]
        if name == "caller":
            return [1, "", self.calls.caller.is_own]
        raise Exception(f'method "{name}" is not supported')

    def verify_request(self, request, client_address):
        return self.door.connections.add(request, door.OWN)

    def shutdown_request(self, request):
        self.door.connections.remove(request)
        super().shutdown_request(request)

    def handle_error(self, _request, _address):
        self.broken.append(1)


@pytest.fixture
def server():
    found = Server()
    yield found
    found.shutdown()
    found.server_close()


def bound(monkeypatch, name, most):
    monkeypatch.setitem(bounds.BOUNDS, name, bounds.Limit(most, BOUNDS[name].what))


def post(server, body, headers=(), source="127.0.0.1"):
    connection = http.client.HTTPConnection(
        "127.0.0.1", server.server_address[1], timeout=20, source_address=(source, 0)
    )
    connection.request("POST", "/RPC2", body, dict(headers))
    answer = connection.getresponse()
    data = answer.read()
    connection.close()
    return xmlrpc.client.loads(gzip.decompress(data) if answer.headers.get("Content-Encoding") == "gzip" else data)[0][
        0
    ]


def call(name, *arguments):
    return xmlrpc.client.dumps(arguments, name, allow_none=True).encode()


VALUES = [
    0,
    -(2**31),
    1.5,
    True,
    "",
    "\u00fc\U0001f916\n<&>",
    [],
    [[1], {}],
    {"a": {"b": []}},
    xmlrpc.client.Binary(b"\0\xff"),
]
VALUES += [xmlrpc.client.DateTime("20260101T00:00:00"), "x" * (5 << 20), [["/topic", ["/node"]]] * 5000]


@pytest.mark.slow
@pytest.mark.parametrize("value", VALUES, ids=lambda value: str(value)[:20])
@pytest.mark.parametrize("packed", [False, True])
def test_what_ordinary_clients_send_is_taken(server, value, packed):
    body = call("echo", value)
    headers = {"Content-Encoding": "gzip", "Accept-Encoding": "gzip"} if packed else {}
    found = post(server, gzip.compress(body, 1) if packed else body, headers)
    assert found == [1, "", value] and type(found[2]) is type(value)
    assert server.refused == []


def test_several_calls_come_over_one_connection(server):
    client = xmlrpc.client.ServerProxy(server.uri)
    assert [client.echo(number)[2] for number in range(5)] == list(range(5))
    assert client.caller()[2] is True
    with pytest.raises(xmlrpc.client.Fault, match="not supported"):
        client.nothing()
    assert len(server.door.connections._open) == 1


def nested(levels):
    inner = "<value><array><data>" * levels + "</data></array></value>" * levels
    return f"<methodCall><methodName>echo</methodName><params><param>{inner}</param></params></methodCall>".encode()


def test_what_is_beyond_a_bound_is_answered_with_a_sentence(server, monkeypatch):
    bound(monkeypatch, "request", 100_000)
    bound(monkeypatch, "text", 50_000)
    bound(monkeypatch, "answer", 1_000_000)
    for body, headers, why in (
        (call("echo", "x" * 200_000), {}, "request"),
        (call("echo", "x" * 60_000), {}, "request"),
        (gzip.compress(call("echo", " " * 1_000_000)), {"Content-Encoding": "gzip"}, "request"),
        (nested(40), {}, "request"),
        (nested(3000), {}, "request"),
        (call("many", 1000, 1000), {}, "answer"),
    ):
        code, text, value = post(server, body, headers)
        assert (code, value) == (-1, 0) and "more than the roscore takes" in text
        assert server.refused.pop() == why
    assert post(server, call("echo", 1)) == [1, "", 1]


BROKEN = {
    "no XML": (b"<", {}),
    "cut": (call("echo", 1)[:-30], {}),
    "a document type": (b'<!DOCTYPE x [<!ENTITY a "b">]>' + call("echo", 1), {}),
    "an encoding": (call("echo", 1), {"Content-Encoding": "br"}),
    "no gzip": (call("echo", 1), {"Content-Encoding": "gzip"}),
    "half of gzip": (gzip.compress(call("echo", 1))[:-20], {"Content-Encoding": "gzip"}),
    "no method": (b"<methodCall><params></params></methodCall>", {}),
    "a value that XML-RPC has not": (call("echo", 1).replace(b"int>", b"bigdecimal>"), {}),
}


@pytest.mark.parametrize(("body", "headers"), BROKEN.values(), ids=BROKEN)
def test_what_is_no_call_is_a_fault(server, body, headers):
    with pytest.raises(xmlrpc.client.Fault):
        post(server, body, headers)
    assert post(server, call("echo", 1)) == [1, "", 1] and server.broken == []


@pytest.mark.parametrize("length", ["", "-1", "x", "9" * 40, "1\r\nTransfer-Encoding: chunked"])
def test_a_length_that_is_none_ends_the_connection(server, length):
    with socket.create_connection(server.server_address) as connection:
        connection.sendall(f"POST / HTTP/1.1\r\nContent-Length: {length}\r\n\r\n".encode() + call("echo", 1))
        answer = b""
        while piece := connection.recv(65536):
            answer += piece
    assert answer.startswith(b"HTTP/1.1 200") and answer.count(b"HTTP/1.1") == 1


@pytest.mark.parametrize("head", [b"POST / HTTP/1.1\r\n" + b"a: b\r\n" * 9000, b"POST /" + b"x" * 90_000])
def test_a_long_head_ends_the_connection(server, head):
    with socket.create_connection(server.server_address) as connection:
        connection.settimeout(10)
        try:
            connection.sendall(head)
            while connection.recv(65536):
                pass
        except ConnectionError:
            pass
    assert post(server, call("echo", 1)) == [1, "", 1]


def test_a_request_that_does_not_end_is_ended(server, monkeypatch):
    monkeypatch.setattr(door, "PATIENCE", 0.3)
    with socket.create_connection(server.server_address) as connection:
        connection.settimeout(10)
        connection.sendall(b"POST / HTTP/1.1\r\nContent-Length: 1000\r\n\r\n<")
        assert connection.recv(100) == b""


def test_an_answer_that_is_not_taken_is_given_up(server, monkeypatch):
    monkeypatch.setattr(door, "PATIENCE", 0.3)
    with socket.create_connection(server.server_address) as connection:
        body = call("many", 1 << 20, 40)
        connection.sendall(b"POST / HTTP/1.1\r\nContent-Length: %d\r\n\r\n" % len(body) + body)
        until = time.monotonic() + 20
        while not server.door.room.used and time.monotonic() < until:
            time.sleep(0.01)
        while server.door.connections._open and time.monotonic() < until:
            time.sleep(0.05)
        assert not server.door.connections._open and server.door.room.used == 0


def test_a_connection_that_breaks_breaks_nothing_else(server):
    for size in (1, 40, 200):
        with socket.create_connection(server.server_address) as connection:
            body = call("echo", "x" * 100)
            connection.sendall((b"POST / HTTP/1.1\r\nContent-Length: %d\r\n\r\n" % len(body) + body)[:size])
    assert post(server, call("echo", 1)) == [1, "", 1]
    assert server.door.room.used == 0


def test_the_longest_idle_connection_ends_when_too_many(server, monkeypatch):
    connections = server.door.connections = door.Connections(3)
    clients = []
    for number in range(5):
        client = xmlrpc.client.ServerProxy(server.uri)
        assert client.echo(number) == [1, "", number]
        clients.append(client)
        assert len(connections._open) <= 3
    assert [client.echo(7)[2] for client in clients] == [7] * 5, "a client connects again"


def test_connections_of_other_computers_end_first():
    connections, ends = door.Connections(4), [socket.socketpair() for _pair in range(5)]
    for (end, _other), robot in zip(ends, (door.OWN, "robot2", *[door.OWN] * 3)):
        assert connections.add(end, robot)
    ends[1][1].settimeout(5)
    assert ends[1][1].recv(1) == b"" and set(connections._open) == {end for end, _other in ends} - {ends[1][0]}
    for end in list(connections._open):
        connections.mark(end, True)
    assert not connections.add(ends[1][0], door.OWN), "all are busy"


@pytest.fixture
def busy():
    """Busy connections: `add(robot)` says whether there was room for one."""
    connections, made = door.Connections(40), []

    def add(robot):
        end, other = socket.socketpair()
        made.append((end, other))
        there = connections.add(end, robot)
        connections.mark(end, True)
        return there

    add.count = lambda robot: sum(state.robot == robot for state in connections._open.values())
    yield add
    for ends in made:
        for end in ends:
            end.close()


def test_other_computers_leave_room_however_busy_they_are(busy):
    assert [busy("robot1") for _count in range(15)].count(True) == 10, "a quarter"
    assert all(busy("robot2") for _count in range(10))
    assert [busy("robot3") for number in range(15)].count(True) == 10, "three quarters of all others"
    assert [busy(door.OWN) for _count in range(15)].count(True) == 10


def test_a_robot_that_holds_most_gives_room_to_another(busy):
    for _count in range(10):
        assert busy("hostile") and busy("robot2") and busy("robot3")
    assert all(busy("robot4") for _count in range(5))
    assert busy.count("robot4") == 5 and sum(map(busy.count, ("hostile", "robot2", "robot3"))) == 25
    assert not all(busy("robot4") for _count in range(5)), "the others have few enough"
    assert busy("robot5")


@pytest.fixture
def stranger(monkeypatch):
    """An address that counts as one of another computer."""
    monkeypatch.setattr(door.Caller, "is_own", property(lambda caller: caller.address != "127.0.0.9"))
    return "127.0.0.9"


@pytest.mark.slow
def test_another_computer_has_its_share_of_the_processor(server, stranger, monkeypatch):
    """In one request, too: a system.multicall waits between its calls."""
    slept = []
    monkeypatch.setattr(throttle, "sleep", lambda seconds: slept.append(seconds) or time.sleep(seconds))
    server.door.throttle = Throttle(0.05, 0.5, 0.05, 10.0)
    calls = [{"methodName": "work", "params": [0.02]}] * 10
    assert len(post(server, call("system.multicall", calls))) == 10 and not slept, "this computer does not wait"
    began = time.monotonic()
    assert len(post(server, call("system.multicall", calls), source=stranger)) == 10
    assert slept and 0.2 < 0.05 + 0.02 + 0.05 * (time.monotonic() - began)
    server.door.throttle = Throttle(0.01, 0.5, 0.0, 0.5)
    assert post(server, call("system.multicall", calls[:3]), source=stranger)[0] == -1
    assert server.refused == ["effort"]
    with pytest.raises((OSError, http.client.HTTPException)):
        post(server, call("echo", 1), source=stranger)
    assert post(server, call("echo", 1)) == [1, "", 1]


def make_room(most, patience=0.05):
    return Room(Shares(most, most // 8 * 3, [], door.OWN, most // 2), 1000, patience)


def test_others_have_half_of_the_memory_and_one_robot_a_part(server):
    room = make_room(1_000_000)
    with room.take("robot2", 300_000):
        for robot, size in (("robot2", 100_000), ("robot3", 250_000)):
            with pytest.raises(NoRoom), room.take(robot, size):
                pass
        with room.take(door.OWN, 500_000), room.take("robot3", 160_000):
            pass
        with pytest.raises(NoRoom), room.take(door.OWN, 800_000):
            pass
    assert room.used == 0
    assert not server.door.room._shares.have_room("robot2", 200 << 20)


def test_a_large_request_waits_for_room():
    room, done = make_room(1_000_000, 5.0), []

    def wait():
        with room.take(door.OWN, 900_000):
            done.append(1)

    with room.take(door.OWN, 900_000):
        thread = threading.Thread(target=wait)
        thread.start()
        time.sleep(0.1)
        assert not done
    thread.join(5)
    assert done


def test_the_values_of_a_call_that_waits_are_counted(server, stranger):
    """A system.multicall of 32 MiB waits between its calls, for 30 s: each of 200 connections could hold its 48 MiB of values."""
    held, dispatch = [], server.door.dispatch
    server.door.dispatch = lambda *called: held.append(server.door.room.used) or dispatch(*called)
    server.door.throttle = Throttle(0.01, 0.5, 0.0, 0.2)
    body = call("system.multicall", [{"methodName": "work", "params": [0.02, "x" * 20_000]}] * 15)
    assert post(server, body, source=stranger)[0] == -1
    assert server.refused == ["effort"] and held[0] > len(body)
    until = time.monotonic() + 5
    while server.door.room.used and time.monotonic() < until:
        time.sleep(0.02)
    assert not server.door.room.used


def test_calls_of_a_multicall_have_answers_of_their_own(server, monkeypatch):
    client = xmlrpc.client.ServerProxy(server.uri)
    calls = [("echo", [1]), ("nothing", []), ("system.multicall", [[]]), ("echo", [2])]
    found = client.system.multicall([{"methodName": name, "params": given} for name, given in calls])
    assert found[0] == [[1, "", 1]] and found[3] == [[1, "", 2]]
    assert [sorted(each) for each in found[1:3]] == [["faultCode", "faultString"]] * 2
    bound(monkeypatch, "answer", 100_000)
    many = [{"methodName": "many", "params": [1000, 10]}] * 20
    assert client.system.multicall(many)[0] == -1
    bound(monkeypatch, "calls", 3)
    assert client.system.multicall(many)[0] == -1
    for wrong in (7, [7], [{}], [{"methodName": 7, "params": []}], [{"methodName": "echo", "params": {}}]):
        try:
            (found,) = client.system.multicall(wrong)
            assert "faultCode" in found
        except xmlrpc.client.Fault:
            pass


@pytest.mark.parametrize(
    ("address", "here", "robot"),
    [
        ("127.0.0.1", "127.0.0.1", None),
        ("10.0.0.1", "10.0.0.1", None),
        ("10.0.0.2", "10.0.0.1", None),  # another computer of this robot
        ("10.0.0.3", "10.0.0.1", "robot2"),
        ("10.9.9.9", "10.0.0.1", ""),
        ("10.9.9.9", "10.9.9.8", ""),  # called at an address that is in no plan
    ],
)
def test_who_registers_is_a_robot_by_all_of_its_computers(address, here, robot):
    hosts = {"10.0.0.1": "robot1", "10.0.0.2": "robot1", "10.0.0.3": "robot2"}
    found = door.Door(print, print, threading.local(), lambda asked: hosts.get(asked, ""))
    assert found.find_other(door.Caller(address, here)) == robot
