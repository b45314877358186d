# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The discovery nodes of masters: real sockets."""

import contextlib
import socket
import threading
import time
import xmlrpc.server

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._base.deadlines import WORKERS, poll
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.measure import masters
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.ros_client.header import (
    decode_fields,
    encode_block,
    encode_header,
)


@pytest.fixture
def discovery():
    """A discovery node whose clock is an hour ahead."""
    server = xmlrpc.server.SimpleXMLRPCServer(("127.0.0.1", 0), logRequests=False)
    server.register_function(lambda: ["http://kobuki2computer:11311/", time.time() + 3600], "getCurrentTime")
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    yield server.server_address[1]
    server.shutdown()
    thread.join()
    server.server_close()


def master(port):
    return {
        "computer": "kobuki2computer",
        "address": "127.0.0.1",
        "rpc_port": port,
        "monitor_uri": f"http://127.0.0.1:{port}",
    }


def test_discovery_node_and_its_clock(discovery):
    found = masters.discovery(master(discovery), 0)
    assert found["open"] and not found["error"]
    assert abs(found["clock_offset_s"] - 3600) <= found["clock_uncertainty_s"] + 1e-3


@pytest.mark.slow
@pytest.mark.parametrize("said", ["nan", "inf", "-inf", "1e999", "1e20", "-1", "4294967296"])
def test_a_time_that_is_no_number_costs_the_clock_alone(said):
    """An answer with such a number would be refused as a whole."""
    with xmlrpc.server.SimpleXMLRPCServer(("127.0.0.1", 0), logRequests=False) as server:
        server.register_function(lambda: ["", float(said)], "getCurrentTime")
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        found = masters.discovery(master(server.server_address[1]), 0)
        server.shutdown()
        thread.join()
    assert found["open"] and found["clock_offset_s"] is None and "is no time" in found["clock_error"]


@pytest.mark.slow
@pytest.mark.parametrize("said", [2**31 - 1, -1, 0, 1e300, "9" * 4000, [], True])
def test_a_port_that_is_none_costs_the_data_of_that_relay_alone(said):
    """An answer with such a number would be refused as a whole."""
    with xmlrpc.server.SimpleXMLRPCServer(("127.0.0.1", 0), logRequests=False) as server:
        server.register_function(lambda robot, revision, wait: ["r", said, []], "rosfleetOffers")
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        channel = {"peer": "kobuki2", "hosts": ["127.0.0.1"], "port": server.server_address[1]}
        (found,) = masters.relays({"robot": "kobuki1", "channels": [channel]})
        server.shutdown()
        thread.join()
    assert (found["outcome"], found["data_outcome"], found["data_port"]) == ("answered", "failed", 0)


def test_the_port_of_a_roscore_is_open_refused_or_not_asked(discovery):
    uri = "http://kobuki2computer:{}/"
    assert masters.discovery(dict(master(discovery), uri=uri.format(discovery)), 0)["roscore"] == "open"
    with socket.socket() as closed:
        closed.bind(("127.0.0.1", 0))
        given = dict(master(discovery), uri=uri.format(closed.getsockname()[1]))
        assert "refused" in masters.discovery(given, 0)["roscore"]
    assert masters.discovery(master(discovery), 0)["roscore"] == ""


@pytest.mark.slow
def test_discovery_that_refuses_or_is_something_else():
    with socket.socket() as closed:
        closed.bind(("127.0.0.1", 0))
        found = masters.discovery(master(closed.getsockname()[1]), 0)
        assert not found["open"] and "refused" in found["error"]
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        thread = threading.Thread(target=lambda: [_greet(other) for turn in range(2)], daemon=True)
        thread.start()
        found = masters.discovery(master(other.getsockname()[1]), 0)
        assert found["open"] and found["clock_offset_s"] is None and "getCurrentTime failed" in found["clock_error"]


def test_discovery_whose_address_is_not_that_of_its_state():
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        found = masters.discovery(dict(master(other.getsockname()[1]), monitor_uri="http://127.0.0.1:9/"), 0)
    assert found["open"] and found["clock_error"] == 'getCurrentTime failed: "Connection refused"'


def _greet(listener):
    connection = listener.accept()[0]
    connection.sendall(b"SSH-2.0-OpenSSH\r\n")
    connection.close()


def test_discovery_that_comes_late_is_awaited():
    with socket.socket() as late:
        late.bind(("127.0.0.1", 0))
        port = late.getsockname()[1]
        threading.Timer(0.7, late.listen).start()
        assert masters.discovery(master(port), time.monotonic() + 0)["open"] is False
        found = {}
        began = time.monotonic()
        found.update(poll(lambda: masters._connect("127.0.0.1", port), lambda seen: seen["open"], began + 10))
        assert found["open"] and time.monotonic() - began < 5


def ask_relay(answer, hosts=("127.0.0.1",)):
    """The row of a relay with this answer."""
    with xmlrpc.server.SimpleXMLRPCServer(("127.0.0.1", 0), logRequests=False) as server:
        asked = []
        server.register_function(lambda *words: asked.append(words) or answer, "rosfleetOffers")
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        channel = {"peer": "kobuki2", "hosts": list(hosts), "port": server.server_address[1]}
        (row,) = masters.relays({"robot": "kobuki1", "channels": [channel, channel]})
        server.shutdown()
        thread.join()
    assert set(asked) <= {("kobuki1", "", 0.0)}
    return row


def test_a_relay_and_the_port_of_its_data():
    with socket.socket() as data:
        data.bind(("127.0.0.1", 0))
        port = data.getsockname()[1]
        row = ask_relay(["1", port, []])
        assert (row["outcome"], row["data_port"], row["data_outcome"]) == ("answered", port, "refused")
        data.listen(1)
        row = ask_relay(["1", port, []])
        assert (row["outcome"], row["data_outcome"], row["error"]) == ("answered", "open", "")


@pytest.mark.slow
@pytest.mark.parametrize("answer", [[], ["1", "x", []], ["1", -4, []], ["1", 99999, []], 7, {}])
def test_another_answer_of_a_relay_is_told_as_one(answer):
    row = ask_relay(answer)
    assert row["outcome"] in ("failed", "answered") and row["data_outcome"] in ("failed", "not_tried") and row["error"]


def test_without_channels_no_relay_is_asked():
    assert masters.relays(None) == masters.relays({}) == masters.relays({"robot": "a", "channels": []}) == []
    (row,) = masters.relays({"robot": "a", "channels": [{"peer": "b", "hosts": ["127.0.0.1"], "port": 1}]})
    assert (row["outcome"], row["data_outcome"]) == ("refused", "not_tried")


SILENT, SPEAKS, REFUSES, MUTE = "silent", "speaks", "refuses", "mute"  # how a data port of a relay answers


@contextlib.contextmanager
def data_port(manner, asked):
    """The data port of a relay, by TCPROS; `asked` gets the header of each connection."""

    def serve(connection):
        with connection, contextlib.suppress(OSError):
            size = int.from_bytes(connection.recv(4), "little")
            if not size:
                return  # a connection that only tries the port
            asked.append(decode_fields(connection.recv(size), "replace"))
            if manner == REFUSES:
                connection.sendall(encode_header({"error": "it is not published here"}))
            elif manner != MUTE:
                connection.sendall(
                    encode_header({"type": "a/B", "md5sum": "0" * 32, "message_definition": "x" * 20000})
                )
            if manner == SPEAKS:
                connection.sendall(encode_block(b"1"))
            ended.wait(10)

    def accept():
        with contextlib.suppress(OSError):
            while True:
                threading.Thread(target=serve, args=(listener.accept()[0],), daemon=True).start()

    ended = threading.Event()
    with socket.create_server(("127.0.0.1", 0)) as listener:
        threading.Thread(target=accept, daemon=True).start()
        yield listener.getsockname()[1]
        ended.set()
        listener.shutdown(socket.SHUT_RDWR)


class OwnRoscore:
    """The roscore of this robot: what its relay publishes, and where that is."""

    def __init__(self, relay, *topics, listeners=()):
        self.relay, self.topics, self.listeners = relay, topics, dict(listeners)  # listeners with their ports

    def read_state(self):
        subscribers = {topic: list(self.listeners) for topic in self.topics}
        return [{topic: ["/master_relay"] for topic in self.topics}, subscribers, {}]

    def ask(self, method, *words):
        (node,) = words
        assert method == "lookupNode"
        return self.relay if node == "/master_relay" else f"http://127.0.0.1:{self.listeners[node]}/"


OFFERS = [["topic", "/kobuki2/scan", "a/B", ["/laser"]], ["topic", "/kobuki2/image", "sensor_msgs/Image", ["/camera"]]]
NOTHING = {"as": "", "base": "", "inner": False}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("here", "there", "expected"),
    [
        (SPEAKS, SPEAKS, ("answered", True, "not_tried")),
        (SILENT, SPEAKS, ("answered", False, "not_tried")),
        (MUTE, SILENT, ("no_answer", False, "answered")),
        (MUTE, MUTE, ("no_answer", False, "no_answer")),
        (REFUSES, REFUSES, ("failed", False, "failed")),
    ],
)
def test_topics_are_heard_through_both_relays(monkeypatch, here, there, expected):
    monkeypatch.setattr(masters.tcpros, "CALL", 1.0)
    asked_here, asked_there = [], []
    with data_port(here, asked_here) as own, data_port(there, asked_there) as other:
        with xmlrpc.server.SimpleXMLRPCServer(("127.0.0.1", 0), logRequests=False) as server:
            server.register_function(lambda *_words: ["1", other, OFFERS], "rosfleetOffers")
            server.register_function(lambda *_words: [1, "", ["TCPROS", "127.0.0.1", own]], "requestTopic")
            thread = threading.Thread(target=server.serve_forever)
            thread.start()
            place = server.server_address[1]
            channel = {"peer": "kobuki2", "hosts": ["127.0.0.1"], "port": place, **NOTHING}
            roscore = OwnRoscore(f"http://127.0.0.1:{place}/", "/kobuki2/scan", "/kobuki2/image", "/mine")
            (row,) = masters.relays({"robot": "kobuki1", "channels": [channel]}, roscore)
            server.shutdown()
            thread.join()
    first, second = row["crossing"]
    assert (first["topic"], second["topic"], first["nodes"]) == ("/kobuki2/scan", "/kobuki2/image", ["/laser"])
    assert (first["outcome"], first["message"], first["there"]) == expected and bool(first["error"]) == (
        expected[0] != "answered"
    )
    assert {one["topic"] for one in asked_here} == {"/kobuki2/scan", "/kobuki2/image"}
    assert all(one["md5sum"] == "*" and "rosfleet_relay" not in one for one in asked_here)
    assert all(one["rosfleet_relay"] == "kobuki1" and one["rosfleet_publisher"] for one in asked_there)
    assert bool(asked_there) == (expected[0] != "answered")


@pytest.mark.parametrize(
    ("offered", "subscribed", "unlike"),
    [
        ("std_msgs/Int32", "std_msgs/String", ["/drive"]),
        ("std_msgs/String", "std_msgs/String", []),
        ("std_msgs/Int32", "*", []),  # rostopic hz takes any
        ("*", "std_msgs/String", []),
        ("std_msgs/Int32", None, []),  # it answers otherwise
    ],
)
def test_a_node_that_subscribes_another_type_says_so_itself(offered, subscribed, unlike):
    class Roscore:
        def ask(self, method, node):
            return {"/drive": place, "/gone": "http://127.0.0.1:1/"}[node]

    rows = [["/other", "a/B"], ["/cmd_vel", subscribed]]
    with xmlrpc.server.SimpleXMLRPCServer(("127.0.0.1", 0), logRequests=False) as server:
        server.register_function(lambda _caller: [1, "", rows] if subscribed else 7, "getSubscriptions")
        place = f"http://127.0.0.1:{server.server_address[1]}/"
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        crossing = masters._make_crossing("/cmd_vel", ("/station/cmd_vel", offered, ("/joy",)))
        nodes = {"/cmd_vel": ["/master_relay", "/gone", "/drive"]}
        found = dict(crossing)
        masters._compare(Roscore(), nodes, [("/cmd_vel", offered, found)])
        server.shutdown()
        thread.join()
    assert found == {**crossing, "unlike": unlike}


@pytest.mark.slow
def test_subscribers_that_hang_take_no_topic_from_those_that_were_heard(monkeypatch):
    """The kernel takes the connection of a node that is stopped. Each is asked once, though both topics have it."""
    monkeypatch.setattr(masters, "RELAYS", 4.0)
    monkeypatch.setattr(masters, "TYPES", 1.0, raising=False)
    with contextlib.ExitStack() as stack:
        hanging = [stack.enter_context(socket.create_server(("127.0.0.1", 0))) for _number in range(4)]
        places = {f"/node_{number}": one.getsockname()[1] for number, one in enumerate(hanging)}
        own, other = (stack.enter_context(data_port(SPEAKS, [])) for _relay in range(2))
        server = stack.enter_context(xmlrpc.server.SimpleXMLRPCServer(("127.0.0.1", 0), logRequests=False))
        server.register_function(lambda *_words: ["1", other, OFFERS], "rosfleetOffers")
        server.register_function(lambda *_words: [1, "", ["TCPROS", "127.0.0.1", own]], "requestTopic")
        thread = threading.Thread(target=server.serve_forever, daemon=True)
        thread.start()
        place = server.server_address[1]
        roscore = OwnRoscore(f"http://127.0.0.1:{place}/", "/kobuki2/scan", "/kobuki2/image", listeners=places)
        channel = {"peer": "kobuki2", "hosts": ["127.0.0.1"], "port": place, **NOTHING}
        began = time.monotonic()
        (row,) = masters.relays({"robot": "kobuki1", "channels": [channel]}, roscore)
        took = time.monotonic() - began
        server.shutdown()
        thread.join()
        assert [(one["outcome"], one["message"], one["unlike"]) for one in row["crossing"]] == [
            ("answered", True, [])
        ] * 2 and took < 4
        for one in hanging:
            one.settimeout(0)
            one.accept()[0].close()
            with pytest.raises(BlockingIOError):
                one.accept()


def test_the_most_offers_that_a_relay_has_are_read():
    """More than 64 KB: a relay with 220 topics was told as one that does not answer."""
    nodes = [[f"/kobuki2/laboratory/node_{number}_{one}" for one in range(2)] for number in range(1000)]
    offers = [["topic", f"/kobuki2/laboratory/topic_{number}", "a/B", of] for number, of in enumerate(nodes)]
    offers[0][3] = ["/node"] * 5000
    with data_port(SPEAKS, []) as data:
        with xmlrpc.server.SimpleXMLRPCServer(("127.0.0.1", 0), logRequests=False) as server:
            server.register_function(lambda *_words: ["1", data, offers], "rosfleetOffers")
            thread = threading.Thread(target=server.serve_forever)
            thread.start()
            row, found = masters._ask_relay("kobuki1", "kobuki2", ["127.0.0.1"], server.server_address[1])
            server.shutdown()
            thread.join()
    assert (row["outcome"], row["data_outcome"], len(found)) == ("answered", "open", len(offers))
    assert [len(of) for _topic, _type, of in found] == [masters.MOST_NODES] + [2] * (len(offers) - 1)


def test_topics_whose_turn_did_not_come_are_left_out(monkeypatch):
    """Mute relays may use up the time of all: the relays behind them have done nothing wrong."""
    end = threading.Event()

    def hear(_relay, _robot, row, topic, offer):
        if row["robot"] < WORKERS:
            end.wait(5)
        return masters._make_crossing(topic, offer)

    monkeypatch.setattr(masters, "RELAYS", 0.3)
    monkeypatch.setattr(masters, "_hear", hear)
    peers = range(WORKERS + 4)
    channels = [{"peer": peer, **NOTHING} for peer in peers]
    roscore = OwnRoscore("http://127.0.0.1:1/", *(f"/{peer}/scan" for peer in peers))

    def look(*order):
        rows = [{"robot": peer, "data_outcome": "open", "crossing": ()} for peer in order]
        offers = [[(f"/{peer}/scan", "a/B", ("/laser",))] for peer in order]
        masters._hear_crossing(roscore, "own", channels, list(zip(rows, offers, strict=True)))
        return {row["robot"]: [one["outcome"] for one in row["crossing"]] for row in rows}

    first, last = look(*peers), look(*reversed(peers))
    end.set()
    assert not any(first.values())
    assert last == {peer: [] if peer < WORKERS else ["answered"] for peer in peers}


def test_a_topic_that_two_robots_give_is_not_heard():
    offers = {"/tf": ("/tf", "a/B", ("/n",)), "/a": ("/a", "a/B", ("/n",))}
    assert masters._choose({"one": offers, "two": {"/tf": offers["/tf"]}}, "one") == [("/a", offers["/a"])]


def test_names_of_what_comes_back_are_those_of_this_robot():
    channel = {"peer": "station", "as": "/kobuki1", "base": "/base", "inner": True}
    offer = ("/kobuki1/cmd_vel", "a/B", ("/joystick",))
    assert masters._name_here("station", [channel], [offer], {"/base/cmd_vel"}) == {"/base/cmd_vel": offer}
