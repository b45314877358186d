# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Two relays as processes, each with a roscore that this file plays, and nodes that know nothing of them."""

import contextlib
import json
import os
import pathlib
import signal
import socket
import struct
import subprocess
import sys
import threading
import time
import xmlrpc.client

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.measure import exchange, masters, traffic
from rosfleet_multimaster.edge.clock import monotonic
from rosfleet_multimaster.protocol.tcpros.header import encode_header
from rosfleet_multimaster.relay.core.frames import DEFINITION, MD5SUM, STATIC_TYPE

from tests.unit.nodes.relay.ends import SUM, End, Publisher, free_port, message, text, tree
from tests.unit.nodes.running_sync import Roscore, serve

NODES = pathlib.Path(__file__).resolve().parents[3] / "roles/nodes/files/python"


def wait_for(condition, seconds=15.0):
    until = monotonic() + seconds
    while not condition():
        assert monotonic() < until
        time.sleep(0.05)


class Node(Publisher):
    """A node that publishes topics."""

    def __init__(self, roscore, name, *topics):
        super().__init__()
        methods = {
            "requestTopic": lambda caller, topic, protocols: [1, "", ["TCPROS", *self.place]],
            "getPid": lambda caller: [1, "", 1],
        }
        self.api, self.uri = serve(methods)
        for topic in topics:
            roscore.register("registerPublisher", name, topic, "std_msgs/String", self.uri)


class Roscpp:
    """A subscriber as roscpp has it: it knows a publisher by its XML-RPC, asks once for the port of its data, and dials that for ever."""

    def __init__(self, roscore, topic):
        self.roscore, self.topic, self.links, self.came = roscore, topic, {}, []

    def turn(self):
        """Take the publishers that the roscore tells, dial those without a connection, and read."""
        nodes = self.roscore.tables["Publisher"].get(self.topic, ())
        uris = {self.roscore.nodes[node] for node in nodes}
        for uri in self.links.keys() - uris:
            self.drop(uri)
            del self.links[uri]
        for uri in uris - self.links.keys():
            with contextlib.suppress(OSError):
                answer = xmlrpc.client.ServerProxy(uri).requestTopic("/roscpp", self.topic, [["TCPROS"]])
                self.links[uri] = [tuple(answer[2][1:]), None]
        for uri, link in self.links.items():
            place, end = link
            try:
                if end is None:
                    end = link[1] = End(socket.create_connection(place, 1))
                    end.connection.settimeout(0.05)
                    end.say(
                        encode_header(
                            {"callerid": "/roscpp", "topic": self.topic, "md5sum": SUM, "type": "std_msgs/String"}
                        )
                    )
                self.came.append(end.next())
            except TimeoutError:
                pass
            except (OSError, EOFError):
                self.drop(uri)

    def drop(self, uri):
        if self.links[uri][1] is not None:
            self.links[uri][1].close()
            self.links[uri][1] = None

    def hears(self, body):
        self.turn()
        return message(body) in self.came


class Robot:
    """A robot: its roscore, and its relay as a process."""

    def __init__(self, folder, name):
        self.folder, self.name, self.roscore, self.port = folder, name, Roscore(), free_port()
        self.process = None

    def start(self, peer, inner, entry=None, **changed):
        channel = {
            "peer": peer.name,
            "hosts": ["127.0.0.1"],
            "port": peer.port,
            "topics": ["/scan"],
            "services": ["/reset"],
            "back": ["/cmd_vel"],
            "as": "/robot",
            "base": "",
            "inner": inner,
            "rate": 0,
            "newest": False,
            "whole": [],
            "frames": "",
            "world": "",
            "root": "",
            **(entry or {}),
        }
        path = self.folder / f"{self.name}.json"
        path.write_text(
            json.dumps({"robot": self.name, "port": self.port, "channels": [channel], "diagnostics": False, **changed})
        )
        environment = {
            "PYTHONPATH": str(NODES),
            "ROS_MASTER_URI": self.roscore.uri,
            "ROS_IP": "127.0.0.1",
            "PATH": os.environ["PATH"],
        }
        words = [sys.executable, "-m", "rosfleet_multimaster.master_relay", "--parameters", str(path)]
        self.process = subprocess.Popen(words, env=environment)

    def published(self):
        """The topics that the relay publishes here."""
        return {topic for topic, nodes in self.roscore.tables["Publisher"].items() if "/master_relay" in nodes}

    @property
    def api(self):
        """Its slave API, at the URI that it has registered."""
        wait_for(lambda: "/master_relay" in self.roscore.nodes)
        return xmlrpc.client.ServerProxy(self.roscore.nodes["/master_relay"])

    def data_port(self):
        """The port for topics and services."""
        return self.api.requestTopic("/x", next(iter(self.published())), [["TCPROS"]])[2][2]

    def connect(self, topic, **fields):
        """A connection to the relay, as a subscriber makes it: after its question for the port."""
        code, why, protocol = self.api.requestTopic("/listener", topic, [["TCPROS"]])
        assert code == 1, why
        end = End(socket.create_connection(protocol[1:], 10))
        end.say(
            encode_header({"callerid": "/listener", "topic": topic, "md5sum": SUM, "type": "std_msgs/String", **fields})
        )
        return end

    def end(self):
        self.process.send_signal(signal.SIGTERM)
        assert self.process.wait(10) == 0
        self.roscore.server.stop()


@pytest.fixture
def pair(tmp_path):
    """A robot and a station, with a channel that the test says."""
    both = Robot(tmp_path, "robot"), Robot(tmp_path, "station")

    def start(entry):
        for one, other in (both, both[::-1]):
            one.start(other, one.name == "robot", entry)
        return both

    yield start
    for one in both:
        one.end()
        assert not one.published(), "all is withdrawn at the end"


@pytest.fixture
def robots(pair):
    return pair({})


@pytest.mark.slow
def test_topics_cross_under_their_names_each_one_way(robots):
    robot, station = robots
    laser, joystick = (
        Node(robot.roscore, "/laser", "/scan", "/odom"),
        Node(station.roscore, "/joystick", "/robot/cmd_vel"),
    )
    wait_for(lambda: station.published() == {"/robot/scan"} and robot.published() == {"/cmd_vel"})
    for node, there, topic, name in (
        (laser, station, "/robot/scan", "/scan"),
        (joystick, robot, "/cmd_vel", "/robot/cmd_vel"),
    ):
        listeners = [there.connect(topic) for _number in range(5)]
        source = node.accept(latching="1")
        assert source.asked["topic"] == name and source.asked["callerid"] == "/master_relay"
        for number in range(100):
            source.say(message(b"%d" % number))
        for listener in listeners:
            header = listener.header()
            assert header["topic"] == topic and header["callerid"] == "/master_relay" and header["md5sum"] == SUM
            texts = [listener.next()]
            while texts[-1] != message(b"99"):
                texts.append(listener.next())
            assert texts == [message(b"%d" % number) for number in range(100 - len(texts), 100)]
        late = there.connect(topic)
        assert late.header()["latching"] == "1" and late.next() == message(b"99")
        for listener in (*listeners, late):
            listener.close()
        with pytest.raises(EOFError):  # nobody listens, so nothing crosses
            source.next()
        node.server.settimeout(0.2)
        with pytest.raises(TimeoutError):  # five listeners were one connection
            node.server.accept()


class Station:
    """The roscore of a station, as a verification asks it."""

    def __init__(self, robot):
        self.roscore = robot.roscore

    def read_state(self):
        return [dict(self.roscore.tables["Publisher"]), {}, {}]

    def ask(self, method, node):
        assert method == "lookupNode"
        return self.roscore.nodes[node]


@pytest.mark.slow
def test_a_verification_hears_what_crosses(robots, monkeypatch):
    """A header of the publisher comes through both relays. Without it, the relay that loses it is told from the other one."""
    robot, station = robots
    laser = Node(robot.roscore, "/laser", "/scan")
    wait_for(lambda: station.published() == {"/robot/scan"})
    channel = {"peer": "robot", "hosts": ["127.0.0.1"], "port": robot.port, "as": "/robot", "base": "", "inner": False}

    sources = []

    def speak():
        with contextlib.suppress(OSError):
            while True:
                sources.append(laser.accept())
                sources[-1].say(message(b"seen"))

    def hear():
        (row,) = masters.relays({"robot": "station", "channels": [channel]}, Station(station))
        assert (row["outcome"], row["data_outcome"]) == ("answered", "open")
        (crossing,) = row["crossing"]
        assert (crossing["topic"], crossing["nodes"]) == ("/robot/scan", ["/laser"])
        return crossing["outcome"], crossing["message"], crossing["there"]

    threading.Thread(target=speak, daemon=True).start()
    assert hear() == ("answered", True, "not_tried")
    monkeypatch.setattr(masters.tcpros, "CALL", 1.5)
    station.process.send_signal(signal.SIGSTOP)
    try:
        assert hear() == ("no_answer", False, "answered")
    finally:
        station.process.send_signal(signal.SIGCONT)


@pytest.mark.slow
def test_what_is_played_again_at_the_station_stays_there(robots, tmp_path):
    """The publisher of a bag has the robot's names there. Neither relay lets it cross, whatever the other one does."""
    robot, station = robots
    laser, player = (
        Node(robot.roscore, "/laser", "/scan"),
        Node(station.roscore, "/play", "/robot/scan", "/robot/cmd_vel"),
    )
    robot.roscore.register("registerSubscriber", "/planner", "/scan", "*", laser.uri)
    Node(robot.roscore, "/teleop", "/cmd_vel")
    wait_for(lambda: station.published() == {"/robot/scan"} and robot.published() == {"/cmd_vel"})
    told = {one: {name for _kind, name, _type, _nodes in ask(one, other)[2]} for one, other in (robots, robots[::-1])}
    assert told == {robot: {"/robot/scan"}, station: {"/robot/cmd_vel"}}
    port = ask(station, robot)[1]
    for fields in ({"rosfleet_relay": "robot", "rosfleet_publisher": "/play"}, {"rosfleet_relay": "robot"}):
        end = End(socket.create_connection(("127.0.0.1", port), 10))
        end.say(encode_header({"callerid": "/master_relay", "md5sum": "*", "topic": "/robot/scan", **fields}))
        assert "is not published here" in end.header()["error"]
    # A relay that keeps to no direction: it offers all.
    station.process.terminate()
    station.process.wait()
    station.start(robot, False, {"topics": ["/cmd_vel"], "services": [], "back": ["/scan", "/cmd_vel"]})
    wait_for(lambda: answers(station, robot) == {"/robot/scan", "/robot/cmd_vel"})
    time.sleep(2)
    assert robot.published() == {"/cmd_vel"} and "/master_relay" not in robot.roscore.tables["Publisher"]["/scan"]
    player.server.settimeout(0.2)
    with pytest.raises(TimeoutError):
        player.accept()


def ask(one, other):
    """The offers that a relay gives another one."""
    return xmlrpc.client.ServerProxy(f"http://127.0.0.1:{one.port}/").rosfleetOffers(other.name, "", 0.0)


def answers(one, other):
    """The names that a relay tells another one; None where it does not answer."""
    with contextlib.suppress(OSError, xmlrpc.client.Error):
        return {name for _kind, name, _type, _nodes in ask(one, other)[2]}


def as_tree():
    """The fields of a header for a tree of frames."""
    return {"type": STATIC_TYPE, "md5sum": MD5SUM, "message_definition": DEFINITION}


@pytest.mark.slow
def test_a_tree_of_frames_crosses_with_its_root(pair):
    frames = {
        "topics": ["/tf", "/tf_static", "/odom"],
        "back": ["/tf"],
        "as": "",
        "frames": "k/",
        "world": "world",
        "root": "map",
    }
    robot, station = pair(frames)
    base = Node(robot.roscore, "/base", "/tf", "/odom")
    wait_for(lambda: station.published() == {"/tf", "/tf_static", "/odom"})
    anything = {"md5sum": "*", "type": "*"}
    fixed = station.connect("/tf_static", **anything)
    assert fixed.header()["md5sum"] == MD5SUM and text(b"world") + text(b"k/map") in fixed.next()
    listener = station.connect("/tf", **anything)
    base.accept(**as_tree()).say(message(tree((b"odom", b"base"))))
    listener.header()
    assert listener.next() == message(tree((b"k/odom", b"k/base")))
    calibration = Node(station.roscore, "/calibration", "/tf")
    wait_for(lambda: robot.published() == {"/tf"})
    inner = robot.connect("/tf", **anything)
    calibration.accept(**as_tree()).say(message(tree((b"k/map", b"k/odom"), (b"world", b"door"))))
    inner.header()
    assert inner.next() == message(tree((b"map", b"odom")))
    odometry = station.connect("/odom", **anything)
    base.accept(type="some/Odometry", message_definition="string frame_id\nTwist twist")
    odometry.connection.settimeout(1)
    with pytest.raises(TimeoutError):  # rather not at all than wrong
        odometry.next()


@pytest.mark.slow
def test_a_rate_sends_the_newest_and_costs_no_goal(pair):
    robot, station = pair({"topics": ["/scan", "/arm/*"], "rate": 5, "whole": ["x/Scan"]})
    nodes = {topic: Node(robot.roscore, "/node" + topic, topic) for topic in ("/scan", "/arm/goal", "/arm/feedback")}
    kinds = {"/arm/goal": "x/ArmActionGoal", "/arm/feedback": "x/ArmActionFeedback", "/scan": "x/Scan"}
    wait_for(lambda: len(station.published()) == 3)
    listeners = {topic: station.connect("/robot" + topic, type="*") for topic in nodes}
    sources = {topic: node.accept(type=kinds[topic]) for topic, node in nodes.items()}
    came = {topic: [] for topic in nodes}

    def listen(topic):
        with contextlib.suppress(EOFError, OSError):
            assert listeners[topic].header()["type"] == kinds[topic]
            while True:
                (sent,) = struct.unpack("<d", listeners[topic].next()[4:])
                came[topic].append(monotonic() - sent)

    threads = [threading.Thread(target=listen, args=[topic]) for topic in nodes]
    for thread in threads:
        thread.start()
    began = monotonic()
    for number in range(60):
        time.sleep(max(0.0, began + number / 10 - monotonic()))
        for source in sources.values():
            source.say(message(struct.pack("<d", monotonic())))
    time.sleep(0.6)
    for listener in listeners.values():
        listener.connection.shutdown(socket.SHUT_RDWR)
    for thread in threads:
        thread.join()
    counts = {topic: len(ages) for topic, ages in came.items()}
    ages = {topic: sorted(these)[len(these) // 2] for topic, these in came.items()}
    print(
        f"{counts}, in the middle {ages['/scan'] * 1000:.1f} ms old, without a rate {ages['/arm/goal'] * 1000:.1f} ms"
    )
    assert counts["/arm/goal"] == 60 and counts["/scan"] == pytest.approx(30, abs=2) == counts["/arm/feedback"]
    assert ages["/scan"] < ages["/arm/goal"] + 0.03


def find_peak(robot):
    """The most memory that a relay has had, in MiB."""
    status = pathlib.Path(f"/proc/{robot.process.pid}/status").read_text()
    return int(status.partition("VmHWM:")[2].split()[0]) >> 10


def send_some(connection, data):
    """Send what may be sent now; all where nobody wants it any more."""
    try:
        return connection.send(data[: 1 << 18])
    except BlockingIOError:
        raise
    except OSError:
        return len(data)


@pytest.mark.slow
def test_memory_is_bounded_whatever_others_send(pair):
    """Listeners that never read, of messages of 1 MB; publishers that stop within 15 MB; headers that never end; and one good topic."""
    robot, station = pair({"topics": ["/t*", "/scan"], "as": "/robot"})
    node = Node(robot.roscore, "/hostile", *[f"/t{number}" for number in range(20)])
    good = Node(robot.roscore, "/laser", "/scan")
    wait_for(lambda: len(station.published()) == 21)
    idle = [station.connect(f"/robot/t{number}") for number in range(20)]
    sources = [node.accept() for _topic in idle]
    headers = [socket.create_connection(("127.0.0.1", station.data_port()), 10) for _number in range(50)]
    for connection in headers:
        connection.sendall(struct.pack("<I", 1 << 17) + bytes((1 << 17) - 1))
    large = memoryview(message(bytes(1 << 20)) * 8 + struct.pack("<I", 15 << 20) + bytes(8 << 20))
    listener = station.connect("/robot/scan")
    source = good.accept()
    source.say(message(b"before"))
    assert listener.header() and listener.next() == message(b"before")
    left = dict.fromkeys(sources, large)
    for one in sources:
        one.connection.setblocking(False)
    until = monotonic() + 60
    while left and monotonic() < until:
        for one, data in list(left.items()):
            with contextlib.suppress(BlockingIOError):
                left[one] = data[send_some(one.connection, data) :]
            if not left[one]:
                del left[one]
    assert not left, "those that do not read hold up nobody"
    source.say(message(b"as ever"))
    assert listener.next() == message(b"as ever"), "who reads is not ended"
    peaks = find_peak(robot), find_peak(station)
    print(f"the relays had {peaks} MiB at most")
    assert max(peaks) < 80
    for end in (*idle, *sources, *headers):
        end.close()


@pytest.mark.slow
def test_the_connections_are_told_as_rospy_does(robots):
    robot, station = robots
    laser = Node(robot.roscore, "/laser", "/scan")
    wait_for(lambda: station.published() == {"/robot/scan"})
    listener = station.connect("/robot/scan", callerid="/rviz\x1b[2J")
    source = laser.accept()
    source.say(message(bytes(1000)))
    assert listener.header() and listener.next()
    told = {one: exchange.links(one.api.getBusInfo("/x")[2]) for one in robots}
    ways = {
        one: [(link["direction"], link["peer"], link["topic"], link["host"]) for link in told[one]] for one in robots
    }
    relay = f"http://127.0.0.1:{robot.port}/"
    assert ways[station] == [
        ("in", relay, "/robot/scan", "127.0.0.1"),
        ("out", "/rviz\\x1b[2J", "/robot/scan", "127.0.0.1"),
    ]
    assert ways[robot] == [
        ("in", laser.uri, "/scan", "127.0.0.1"),
        ("out", "/master_relay", "/robot/scan", "127.0.0.1"),
    ]
    for one in robots:
        counted = traffic.counters(one.api.getBusStats("/x"))
        number = told[one][1]["number"]
        assert list(counted) == [number] and counted[number][0] > 1004 and counted[number][1] == 1


@pytest.mark.slow
def test_a_service_is_called_across(robots):
    robot, station = robots
    provider = Publisher()
    robot.roscore.register(
        "registerService", "/base", "/reset", f"rosrpc://127.0.0.1:{provider.place[1]}", "http://127.0.0.1:1/"
    )
    wait_for(lambda: "/master_relay" in station.roscore.tables["Service"].get("/robot/reset", ()))
    uri = station.roscore.service_uris["/robot/reset"]
    for number in range(3):
        client = End(socket.create_connection(("127.0.0.1", int(uri.rpartition(":")[2])), 10))
        header = encode_header({"callerid": "/client", "service": "/robot/reset", "md5sum": SUM, "persistent": "1"})
        client.say(header + message(b"at once"))
        service = End(provider.server.accept()[0])
        asked = service.header()
        assert asked == {"callerid": "/master_relay", "service": "/reset", "md5sum": SUM, "persistent": "1"}
        assert service.next() == message(b"at once")
        service.say(encode_header({"callerid": "/base", "md5sum": SUM}))
        assert client.header()["callerid"] == "/base"
        large = message(bytes([number]) * 3_000_000)
        client.say(message(b"question"))
        assert service.next() == message(b"question")
        service.say(large)
        assert client.next() == large
        client.close()
        with pytest.raises(EOFError):
            service.next()
    own = "rosrpc://127.0.0.1:1"
    station.roscore.register("registerService", "/own", "/robot/reset", own, "http://127.0.0.1:2/")
    time.sleep(2.5)
    assert station.roscore.service_uris["/robot/reset"] == own, "one of the robot itself is never replaced"


@pytest.mark.slow
def test_a_node_that_was_started_again_is_found_again(robots):
    """It was killed, so its registration stays, until the new one takes its place."""
    robot, station = robots
    laser = Node(robot.roscore, "/laser", "/scan")
    wait_for(lambda: station.published() == {"/robot/scan"})
    listener = station.connect("/robot/scan")
    source = laser.accept()
    assert listener.header()
    laser.server.close()
    laser.api.stop()
    source.close()
    del robot.roscore.nodes["/laser"]
    again = Node(robot.roscore, "/laser", "/scan")
    again.accept().say(message(b"again"))
    assert listener.next() == message(b"again"), "the listener keeps its connection"


@pytest.mark.slow
def test_a_killed_relay_is_replaced_without_a_trace(robots):
    robot, station = robots
    laser = Node(robot.roscore, "/laser", "/scan")
    wait_for(lambda: station.published() == {"/robot/scan"})
    listener = station.connect("/robot/scan")
    laser.accept()
    assert listener.header()
    robot.process.kill()
    robot.process.wait()
    robot.start(station, True)
    again = laser.accept()
    again.say(message(b"again"))
    assert listener.next() == message(b"again"), "the listener keeps its connection"


@pytest.mark.slow
@pytest.mark.parametrize("number", [0, 1], ids=["of_the_publisher", "of_the_listener"])
def test_roscpp_hears_again_when_a_relay_was_killed(robots, number):
    robot, station = robots
    laser = Node(robot.roscore, "/laser", "/scan")
    wait_for(lambda: station.published() == {"/robot/scan"})
    listener = Roscpp(station.roscore, "/robot/scan")
    listener.turn()
    laser.accept(latching="1").say(message(b"before"))
    wait_for(lambda: listener.hears(b"before"))
    killed, other = robots[number], robots[1 - number]
    killed.process.kill()
    killed.process.wait()
    began = monotonic()
    killed.start(other, number == 0)
    said = threading.Thread(target=lambda: laser.accept(latching="1").say(message(b"again")))
    said.start()
    wait_for(lambda: listener.hears(b"again"))
    print(f"heard again after {monotonic() - began:.2f} s")
    said.join()


@pytest.mark.slow
def test_only_who_a_channel_names_is_served(robots):
    robot, station = robots
    Node(robot.roscore, "/laser", "/scan", "/odom")
    wait_for(lambda: station.published() == {"/robot/scan"})
    api = xmlrpc.client.ServerProxy(f"http://127.0.0.1:{robot.port}/")
    with pytest.raises(xmlrpc.client.Fault, match="no channel leads there"):
        api.rosfleetOffers("stranger", "", 0.0)
    with pytest.raises(xmlrpc.client.Fault, match="no method"):  # that one is for other relays alone
        api.shutdown("/x", "")
    port = api.rosfleetOffers("station", "", 0.0)[1]
    for fields in (
        {"topic": "/scan"},
        {"topic": "/robot/odom", "rosfleet_relay": "station", "rosfleet_publisher": "/laser"},
        {"topic": "/robot/scan", "rosfleet_relay": "stranger", "rosfleet_publisher": "/laser"},
        {"topic": "/robot/scan", "rosfleet_relay": "station", "rosfleet_publisher": "/other"},
        {},
    ):
        end = End(socket.create_connection(("127.0.0.1", port), 10))
        end.say(encode_header({"callerid": "/x", "md5sum": "*", **fields}))
        assert "is not published here" in end.header()["error"], fields


@pytest.mark.slow
def test_a_topic_that_is_gone_is_gone_on_both(robots):
    robot, station = robots
    Node(robot.roscore, "/laser", "/scan")
    wait_for(lambda: station.published() == {"/robot/scan"})
    robot.roscore.register("unregisterPublisher", "/laser", "/scan", "")
    wait_for(lambda: not station.published())


@pytest.mark.slow
def test_a_listener_stays_where_a_topic_goes_and_comes(robots):
    """As where a link is cut for long: nodes are told nothing of what the roscore learns too late."""
    robot, station = robots
    laser = Node(robot.roscore, "/laser", "/scan")
    wait_for(lambda: station.published() == {"/robot/scan"})
    listener = station.connect("/robot/scan")
    before = laser.accept()
    assert listener.header()
    robot.roscore.register("unregisterPublisher", "/laser", "/scan", "")
    wait_for(lambda: not station.published())
    robot.roscore.register("registerPublisher", "/laser", "/scan", "std_msgs/String", laser.uri)
    laser.accept().say(message(b"again"))
    assert listener.next() == message(b"again"), "it has heard of nothing"
    before.close()


@pytest.mark.slow
def test_the_reason_of_who_ends_the_relay_is_quoted(tmp_path, capfd):
    robot = Robot(tmp_path, "robot")
    Node(robot.roscore, "/laser", "/scan")
    robot.start(robot, True, {"back": ["/scan"]})
    assert robot.api.getPid("/other")[2] == robot.process.pid
    with contextlib.suppress(OSError, xmlrpc.client.Error):  # it may end before it has answered
        robot.api.shutdown("/other", "all is well")
    assert robot.process.wait(10) == 1
    robot.roscore.server.stop()
    assert 'somebody ended this node: "all is well"' in capfd.readouterr().err
