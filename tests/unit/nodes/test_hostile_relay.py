# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""A relay as a process, with a good robot and a hostile one beside it: what the hostile one does harms nobody but itself.

The computers are addresses of the loopback network: the relay 127.0.0.1, the hostile robot 127.0.0.2, the good one 127.0.0.3.
"""

import contextlib
import http.client
import json
import os
import pathlib
import socket
import struct
import subprocess
import sys
import threading
import time
import xmlrpc.client

import pytest
from rosfleet_multimaster.edge.rpc_server import RpcServer
from rosfleet_multimaster.protocol.tcpros.header import encode_header

from tests.unit.nodes.relay.ends import DEAR, DEEP, HEADER, SUM, End, Publisher, free_port, message
from tests.unit.nodes.running_sync import Roscore

pytestmark = pytest.mark.whole

NODES = pathlib.Path(__file__).resolve().parents[3] / "roles/nodes/files/python"
HERE, BAD, GOOD, THIRD = "127.0.0.1", "127.0.0.2", "127.0.0.3", "127.0.0.4"
ALSO_BAD = "127.0.0.5"  # another computer of the hostile robot


def wait_for(condition, seconds=15.0):
    until = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < until
        time.sleep(0.05)


class Peer:
    """The relay of another robot, which offers and serves as the test says."""

    def __init__(self, name, address):
        self.name, self.address, self.revision, self.offers = name, address, 0, []
        self.asked, self.header = [], HEADER  # headers of connections, and the one that is sent
        self.data = socket.create_server((address, 0), backlog=200)
        self.server = RpcServer(address, 0, {"rosfleetOffers": self.tell}, lambda *_why: None)

    def tell(self, _robot, revision, wait):
        until = time.monotonic() + min(wait, 1.0) * bool(revision)
        while f"r{self.revision}" == revision and time.monotonic() < until:
            time.sleep(0.05)
        return [f"r{self.revision}", self.data.getsockname()[1], self.offers]

    def offer(self, *offers):
        self.offers, self.revision = [list(offer) for offer in offers], self.revision + 1

    def serve(self, talk):
        """Answer each connection with a header, and do something with it in a thread."""

        def one(connection):
            with contextlib.suppress(OSError, EOFError):
                end = End(connection)
                self.asked.append(end.header())
                end.say(encode_header(self.header))
                talk(end)

        def run():
            with contextlib.suppress(OSError):
                while True:
                    threading.Thread(target=one, args=(self.data.accept()[0],), daemon=True).start()

        threading.Thread(target=run, daemon=True).start()

    def channel(self):
        empty = dict.fromkeys(("base", "frames", "world", "root"), "")
        names = {"topics": ["/*"], "services": ["/*"], "back": [], "as": f"/{self.name}"}
        place = {"peer": self.name, "hosts": [self.address], "port": self.server.server_address[1]}
        return {**place, **names, **empty, "inner": False, "rate": 0, "newest": False, "whole": []}

    def member(self):
        own = {"robot": self.name, "name": self.name, "uris": [f"http://{self.address}:11311"], "rpc_port": 11611}
        return {
            **own,
            "addresses": [self.address],
            "hosts": [self.address, *([ALSO_BAD] if self.name == "bad" else [])],
        }


class Station:
    """The relay, and connections to it."""

    def __init__(self, folder, **bad):
        """`bad`: what is in the channel of the hostile robot instead."""
        self.roscore, self.peers = Roscore(), (Peer("bad", BAD), Peer("good", GOOD))
        self.port = free_port()
        third = Peer("third", THIRD)
        channels = [{**self.peers[0].channel(), **bad}, self.peers[1].channel()]
        own = {**channels[1], "inner": True, "topics": ["/own/*"], "services": ["/own/*"], "as": "/station"}
        values = {"robot": "station", "port": self.port, "channels": [*channels, own]}
        self.log = folder / "log"
        members = {"members": [peer.member() for peer in (*self.peers, third)], "strangers": "ignore"}
        path = folder / "relay.json"
        path.write_text(json.dumps({**values, **members, "diagnostics": False}))
        environment = {
            **{"PYTHONPATH": str(NODES), "ROS_MASTER_URI": self.roscore.uri, "ROS_IP": HERE},
            "PATH": os.environ["PATH"],
        }
        self.bad, self.good = self.peers
        self.good.offer(["topic", "/good/scan", "x/Y", ["/laser"]], ["service", "/good/reset", "", ["/base"]])
        words = [sys.executable, "-m", "rosfleet_multimaster.master_relay", "--parameters", str(path)]
        with self.log.open("wb") as log:
            self.process = subprocess.Popen(words, env=environment, stderr=log)
        self.good.serve(self.talk)
        wait_for(lambda: {"/good/scan", "/good/reset"} <= self.names())
        self.data = self.api.requestTopic("/x", "/good/scan", [["TCPROS"]])[2][2]

    def talk(self, end):
        while True:
            end.say(message(struct.pack("<4sd", b"data", self.spent())))
            time.sleep(0.02)

    @property
    def api(self):
        return xmlrpc.client.ServerProxy(self.roscore.nodes["/master_relay"])

    def names(self):
        """The topics and services of the relay at its roscore."""
        tables = (self.roscore.tables[role].items() for role in ("Publisher", "Service"))
        return {name for table in tables for name, nodes in table if "/master_relay" in nodes}

    def told(self):
        """The names that the good robot is offered."""
        connection = http.client.HTTPConnection(HERE, self.port, timeout=10, source_address=(GOOD, 0))
        body = xmlrpc.client.dumps(("good", "", 0.0), "rosfleetOffers")
        connection.request("POST", "/", body, {"Content-Type": "text/xml"})
        (answer,), _method = xmlrpc.client.loads(connection.getresponse().read())
        connection.close()
        return {name for _kind, name, _type, _nodes in answer[2]}

    def offer(self, *offers):
        self.bad.offer(*offers, ["topic", "/bad/last", "x/Y", ["/n"]])
        wait_for(lambda: "/bad/last" in self.names())

    def connect(self, source=HERE, **fields):
        connection = socket.create_connection((HERE, self.data), 10, (source, 0))
        end = End(connection)
        if fields:
            end.say(encode_header({"callerid": "/x", "md5sum": SUM, "type": "x/Y", **fields}))
        return end

    def hears(self, seconds=3.0, source=HERE):
        """Return True if a listener of the good robot's topic has a message in time."""
        try:
            end = self.connect(source, topic="/good/scan")
            end.connection.settimeout(seconds)
            return "error" not in end.header() and end.next()[4:8] == b"data"
        except (OSError, EOFError):
            return False

    def spent(self):
        """The time of the processor that the relay's loop has had, in seconds: a busy machine makes all else longer."""
        return (
            int(pathlib.Path(f"/proc/{self.process.pid}/task/{self.process.pid}/schedstat").read_text().split()[0])
            / 1e9
        )

    def measure_delays(self, seconds=3.0):
        """The processor time of the relay while messages of the good robot wait in it: the median, and the most."""
        end = self.connect(topic="/good/scan")
        end.header()
        until, delays = time.monotonic() + seconds, []
        while time.monotonic() < until or len(delays) < 20:
            (said,) = struct.unpack("<d", end.next()[8:])
            delays.append(self.spent() - said)
        end.close()
        return sorted(delays)[len(delays) // 2], max(delays)

    def is_prompt(self):
        """Return True if a listener hears, and a call is answered, before the relay has done much else: half a second, and two."""
        began = self.spent()
        assert self.hears(60.0)
        heard = self.spent()
        assert self.calls(60.0)
        print(f"heard after {heard - began:.2f} s, answered after {self.spent() - heard:.2f} s of the relay")
        return heard - began < 0.5 and self.spent() - heard < 2.0

    def calls(self, seconds=2.0):
        """Return True if a call of the good robot's service is answered in time."""
        try:
            end = self.connect(service="/good/reset")
            end.connection.settimeout(seconds)
            return "error" not in end.header() and end.next()[4:8] == b"data"
        except (OSError, EOFError):
            return False

    def measure_load(self, seconds=1.0):
        """The share of a core that the relay takes."""

        def spent():
            words = pathlib.Path(f"/proc/{self.process.pid}/stat").read_text().rpartition(")")[2].split()
            return (int(words[11]) + int(words[12])) / os.sysconf("SC_CLK_TCK")

        before = spent()
        time.sleep(seconds)
        return (spent() - before) / seconds

    def end(self):
        assert self.process.poll() is None, "it has lived through all of it"
        self.process.terminate()
        self.process.wait(10)
        self.roscore.server.stop()
        for peer in self.peers:
            peer.data.close()
            peer.server.stop()


@pytest.fixture
def station(tmp_path):
    found = Station(tmp_path)
    yield found
    found.end()


@pytest.fixture
def framed(tmp_path):
    """A station whose frames have other names at the hostile robot."""
    found = Station(tmp_path, inner=True, frames="station/", back=["/bad/*"], **{"as": ""})
    yield found
    found.end()


@pytest.mark.parametrize("dear", DEAR)
def test_messages_that_cost_much_delay_nobody(framed, dear):
    """Each of them has texts in types in each other, so a few bytes are many steps."""
    framed.bad.header = {**HEADER, "type": "x/Y", "message_definition": DEEP}

    def talk(end):
        while True:
            end.say(DEAR[dear])

    framed.bad.serve(talk)
    names = [f"/bad/t{number}" for number in range(12)]
    framed.offer(*(["topic", name, "x/Y", ["/n"]] for name in names))
    listeners = [framed.connect(topic=name) for name in names]
    wait_for(lambda: len(framed.bad.asked) == len(names), 90)
    median, longest = framed.measure_delays(6.0)
    print(f"a message waits for {1000 * median:.0f} ms, and {1000 * longest:.0f} ms at most")
    assert median < 0.05 and longest < 0.2
    assert framed.is_prompt()
    assert framed.measure_load() < 0.8
    # A machine that is busy with other things gives it less than its share.
    assert framed.log.read_text().count("bad: its messages take more of the processor") <= 1
    for end in listeners:
        end.close()


ODD = {
    "no nodes": ["topic", "/bad/x", "x/Y", []],
    "odd nodes": ["topic", "/bad/x", "x/Y", ["n", "/a b"]],
    "no provider": ["service", "/bad/x", "", []],
}


@pytest.mark.parametrize("offer", ODD.values(), ids=list(ODD))
def test_an_odd_offer_is_left_out_alone(station, offer):
    station.offer(offer)
    assert "/bad/x" not in station.names() and station.hears()


def test_an_odd_wait_is_none(station):
    body = xmlrpc.client.dumps(("bad", "", 0.0), "rosfleetOffers").replace("0.0", "nan")
    head = f"POST / HTTP/1.1\r\nHost: x\r\nContent-Type: text/xml\r\nContent-Length: {len(body)}\r\n\r\n"
    for _time in range(3):
        with socket.create_connection((HERE, station.port), 10, (BAD, 0)) as connection:
            connection.sendall((head + body).encode())
            connection.settimeout(5)
            assert connection.recv(100).startswith(b"HTTP/1.1")
    assert station.measure_load() < 0.5


THIRD_NUMBER = 0x7F000004  # 127.0.0.4
SPELLINGS = [
    "127.0.0.4",
    str(THIRD_NUMBER),
    "127.4",
    "0x7f.4",
    "0177.0.0.4",
    "127.0.0.4.",
    "[::ffff:127.0.0.4]",
    "unknown",
]


def test_what_other_robots_have_here_never_crosses_as_own(station):
    """Nodes of another robot registered here, by whatever spelling of its address, and a service of it in an own node's name."""
    for number, host in enumerate(SPELLINGS):
        uri = f"http://{host}:40000/"
        station.roscore.register("registerPublisher", f"/third{number}", f"/own/third{number}", "x/Y", uri)
    service = f"rosrpc://{THIRD}:40000"
    station.roscore.register("registerService", "/node", "/own/service", service, f"http://{HERE}:40000/")
    station.roscore.register("registerPublisher", "/node", "/own/topic", "x/Y", f"http://{HERE}:40000/")
    wait_for(lambda: "/station/own/topic" in station.told())
    assert station.told() == {"/station/own/topic"} and station.hears()


@pytest.mark.parametrize("place", [[THIRD, 0], [str(THIRD_NUMBER), 0], ["127.4", 0], [BAD, 0], [HERE, -1]])
def test_an_own_node_has_no_connection_made_to_another_robot(station, place):
    """It says itself where its messages are to be had: only an own computer counts."""
    with contextlib.ExitStack() as ends:
        there = ends.enter_context(socket.create_server((THIRD, 0)))
        own = ends.enter_context(socket.create_server((HERE, 0)))
        words = {"asked": ["TCPROS", place[0], place[1] or there.getsockname()[1]]}
        api = RpcServer(HERE, 0, {"requestTopic": lambda *_question: [1, "", words["asked"]]}, lambda *_why: None)
        ends.callback(api.stop)
        uri = f"http://{HERE}:{api.server_address[1]}/"
        station.roscore.register("registerPublisher", "/node", "/own/topic", "x/Y", uri)
        wait_for(lambda: "/station/own/topic" in station.told())
        listener = station.connect(GOOD, topic="/station/own/topic", rosfleet_relay="good", rosfleet_publisher="/node")
        there.settimeout(2)
        with pytest.raises(TimeoutError):
            there.accept()
        words["asked"] = ["TCPROS", HERE, own.getsockname()[1]]
        own.settimeout(10)
        own.accept()[0].close()
        listener.close()


def test_silent_connections_of_one_computer_shut_nobody_out(station):
    silent = [socket.create_connection((HERE, station.data), 10, (BAD, 0)) for _number in range(120)]
    assert station.hears()
    for connection in silent:
        connection.close()


def count_dials(port):
    """The number of connections to a port of the hostile robot without an answer yet (state 2 of /proc/net/tcp)."""
    rows = [line.split() for line in pathlib.Path("/proc/net/tcp").read_text().splitlines()]
    return sum(row[2:4] == [f"0200007F:{port:04X}", "02"] for row in rows)


def test_a_port_that_does_not_answer_holds_nobody_up(station):
    """Its queue is full, so the kernel drops what comes. One listener wants forty publishers there."""
    station.bad.data.close()
    station.bad.data = socket.create_server((BAD, 0), backlog=0)
    waiting = []
    for _number in range(4):
        waiting.append(socket.socket())
        waiting[-1].setblocking(False)
        waiting[-1].connect_ex(station.bad.data.getsockname())
    station.offer(["topic", "/bad/x", "x/Y", [f"/n{number}" for number in range(40)]])
    port = station.bad.data.getsockname()[1]
    own = count_dials(port)
    listener = station.connect(topic="/bad/x")  # held: it would leave at once, and want nothing
    wait_for(lambda: count_dials(port) > own)
    assert station.hears() and station.hears()
    assert count_dials(port) > own, "it has waited there all the time"
    listener.close()
    for connection in waiting:
        connection.close()


def test_a_listener_that_talks_is_sent_away(station):
    end = station.connect(topic="/good/scan")
    assert "error" not in end.header()
    with pytest.raises(OSError):
        while True:
            end.say(bytes(1 << 16))
    assert station.hears()


def test_calls_of_one_robot_leave_room_for_others(station):
    station.offer(["service", "/bad/reset", "", ["/base"]])
    station.bad.serve(lambda _end: time.sleep(60))
    local = [station.connect(service="/bad/reset") for _number in range(60)]
    answers = [call.header() for call in local]
    assert sum("too many" in answer.get("error", "") for answer in answers) == 10
    assert "error" not in station.connect(service="/good/reset").header()


def test_a_robot_without_a_channel_hears_and_calls_nobody(station):
    assert not station.hears(source=THIRD)
    end = station.connect(THIRD, service="/good/reset")
    assert "not provided here" in end.header()["error"] and not station.good.asked


def test_a_call_without_a_provider_gets_a_sentence(station):
    station.offer(["service", "/bad/reset", "", ["/base"]])
    station.bad.data.close()
    answer = station.connect(service="/bad/reset").connection.recv(1000)
    assert b"error=/bad/reset cannot be reached" in answer


def read_memory(station):
    """The memory of a relay in MiB."""
    lines = pathlib.Path(f"/proc/{station.process.pid}/status").read_text()
    return int(lines.partition("VmRSS:")[2].split()[0]) >> 10


def test_long_fields_of_listeners_are_not_kept(station):
    before = read_memory(station)
    ends = [station.connect(topic="/good/scan", callerid="/\u4e00" + "x" * 200_000) for _number in range(60)]
    assert all("error" not in end.header() for end in ends)
    assert read_memory(station) - before < 30


def test_a_robot_counts_once_whatever_its_addresses(station):
    silent = [
        socket.create_connection((HERE, station.data), 10, (source, 0))
        for source in (BAD, ALSO_BAD)
        for _number in range(40)
    ]
    assert station.hears()
    wait_for(lambda: sum(is_closed(connection) for connection in silent) == 30)


def is_closed(connection):
    connection.settimeout(0.01)
    try:
        while connection.recv(1000):
            pass
        return True
    except TimeoutError:
        return False
    except OSError:
        return True


def test_silent_calls_of_a_robot_leave_room_at_their_place(framed):
    """One provider, which others want, too."""
    provider = Publisher()
    uri = f"rosrpc://{HERE}:{provider.place[1]}"
    framed.roscore.register("registerService", "/base", "/own/reset", uri, f"http://{HERE}:1/")
    time.sleep(1.5)  # it is read each second
    silent = [framed.connect(BAD, service="/own/reset", rosfleet_relay="bad") for _number in range(60)]
    held = [provider.server.accept()[0] for _number in range(50)]
    wait_for(lambda: sum(is_closed(end.connection) for end in silent) == 10)
    friend = framed.connect(GOOD, service="/station/own/reset", rosfleet_relay="good")
    end = End(provider.server.accept()[0])
    end.header()
    end.say(encode_header({"callerid": "/base", "md5sum": SUM}) + message(b"done"))
    assert friend.header()["callerid"] == "/base" and friend.next() == message(b"done")
    for connection in held:
        connection.close()


def test_all_that_is_kept_of_a_robot_is_in_the_budget(framed):
    """Three hundred publishers, each with a long header and a large definition, and listeners for all of them."""
    sentence = "# \u4e00" + "x" * 90 + "\n"
    fields = "".join(f"string[] field{number}\n" for number in range(1900)) + "string frame_id\n"
    definition = fields + sentence * ((200_000 - len(fields)) // len(sentence))
    framed.bad.header = {**HEADER, "type": "x/Y", "message_definition": definition}
    framed.bad.serve(lambda _end: time.sleep(120))
    names = [f"/bad/t{number}" for number in range(300)]
    before = read_memory(framed)
    framed.offer(*(["topic", name, "x/Y", ["/n"]] for name in names))
    listeners = [framed.connect(topic=name) for name in names]
    most, until = 0, time.monotonic() + 20
    while time.monotonic() < until:
        most = max(most, read_memory(framed))
        time.sleep(0.2)
    print(f"{before} MiB before, {most} MiB at most, {len(framed.bad.asked)} connections")
    assert len(framed.bad.asked) > 20, "it was asked"
    assert most - before < 60
    assert framed.is_prompt()
    for end in listeners:
        end.close()
