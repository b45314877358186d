# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The registrations that the probe finds at a robot's roscore: a roscore and nodes as far as the probe asks them, over real sockets."""

import io
import json
import os
import pathlib
import socket
import sys
import threading
import time
import types

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._contract.outcomes import Outcome
from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine.outcomes import PortAnswer
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.measure import exchange
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.ros_client import message_types
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.ros_client import ros as probe_ros
from hypothesis import given
from hypothesis import strategies as st
from provider import GET_SYNC_INFO, answer, head, provider, rows, synced

MEMBERS = [
    {"name": "here", "address": "127.0.0.1", "discovery_address": "", "robot": "one"},
    {"name": "there", "address": "127.0.0.2", "discovery_address": "127.0.0.3", "robot": "two"},
    {"name": "behind", "address": "127.0.0.4", "discovery_address": "", "robot": "two"},
]
THERE = "http://there:11311/"


class Node:
    """A node as far as its connections go."""

    def __init__(self, *links):
        self.links = links

    def getBusInfo(self, caller):
        return 1, "bus info", [list(link) for link in self.links]


class Master:
    """The roscore of robot one: /base and /ear are its own, /planner is of robot two, /dead does not answer."""

    sync = ""
    imports = {THERE: {"/planner": "http://127.0.0.2:1/"}}

    def __init__(self):
        self.uris = {"/planner": "http://127.0.0.2:1/", "/dead": "http://127.0.0.1:1/"}

    def getSystemState(self, caller):
        publishers = [["/odom", ["/base"]], ["/goal", ["/planner", "/dead"]]]
        services = [["/plan", ["/planner"]], ["/base/reset", ["/base"]], ["/other_sync/get_sync_info", ["/other_sync"]]]
        return 1, "", [publishers, [["/goal", ["/base"]], ["/odom", ["/planner"]]], services]

    def getTopicTypes(self, caller):
        return 1, "", [["/odom", "nav_msgs/Odometry"], ["/goal", "geometry_msgs/Pose"]]

    def getParam(self, caller, name):
        if self.imports is None:
            return -1, "not set", 0
        return 1, "", json.dumps({"node": "/master_sync", "uri": "x", "imports": self.imports})

    def lookupService(self, caller, service):
        return 1, "", self.sync

    def lookupNode(self, caller, node):
        return (1, "", self.uris[node]) if node in self.uris else (-1, "unknown node", "")


# Stands for the Python of ROS.
PYTHON = """#!/usr/bin/env python3
import json, sys
assert sys.argv[1] == "-c" and "roslib" in sys.argv[2]
asked = json.load(sys.stdin)
print("a package that talks when it is imported")
assert asked == ["geometry_msgs/Pose", "nav_msgs/Odometry"]
print(json.dumps({"nav_msgs/Odometry": "cd5e"}))
"""


@pytest.fixture
def ros(tmp_path, served):
    """The ROS of a computer whose roscore and Python are pretended, and the roscore."""
    tmp_path.chmod(0o755)
    for folder in tmp_path.parents:
        if folder.stat().st_uid == os.geteuid() and folder != folder.parent:
            folder.chmod(folder.stat().st_mode | 0o011)
    for name, text in (("python", PYTHON), ("rostopic", f"#!{tmp_path}/python\n")):
        (tmp_path / name).write_text(text)
        (tmp_path / name).chmod(0o755)
    master = Master()
    (tmp_path / "environment").write_text(f"ROS_MASTER_URI={served(master)}\nPATH={tmp_path}:/usr/bin:/bin\n")
    return probe_ros.Ros(str(tmp_path / "environment")), master


def looked_at(ros):
    return exchange.exchange(ros, MEMBERS, "here")


def test_what_is_of_whom(ros, served):
    made, master = ros
    master.uris["/base"] = served(Node())
    found = looked_at(made)
    assert found["error"] == found["types_error"] == ""
    assert [(topic["name"], topic["publishers"], topic["subscribers"]) for topic in found["topics"]] == [
        ("/goal", ["/dead"], ["/base"]),
        ("/odom", ["/base"], []),
    ]
    assert [topic["md5sum"] for topic in found["topics"]] == ["", "cd5e"]
    assert {"name": "/base/reset", "node": "/base"} in found["services"]
    assert found["imports"] == [
        {
            "master": THERE,
            "topics": [
                {"name": "/goal", "type": "geometry_msgs/Pose", "publishers": ["/planner"], "subscribers": []},
                {"name": "/odom", "type": "nav_msgs/Odometry", "publishers": [], "subscribers": ["/planner"]},
            ],
            "services": [{"name": "/plan", "node": "/planner"}],
        }
    ]


def test_an_own_node_that_took_an_imported_name_is_own(ros, served):
    made, master = ros
    master.uris["/planner"] = served(Node())
    found = looked_at(made)
    assert found["imports"] == [] and {"name": "/plan", "node": "/planner"} in found["services"]


def test_a_registered_node_that_does_not_answer_is_silent(ros, served):
    made, master = ros
    master.uris["/base"] = served(Node())
    began = time.monotonic()
    found = looked_at(made)
    assert found["silent"] == ["/dead"]
    (silence,) = found["silences"]
    assert silence["node"] == "/dead" and silence["error"]
    assert f":{silence['port']}/" in master.uris["/dead"]
    assert time.monotonic() - began < 20


@pytest.mark.parametrize(("listens", "outcome", "tcp"), [(True, "no_answer", "open"), (False, "refused", "refused")])
def test_a_node_that_hangs_is_told_from_one_that_has_ended(monkeypatch, listens, outcome, tcp):
    monkeypatch.setattr(
        "ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.ros_client.xml_rpc.CALL", 0.5
    )
    with socket.socket() as server:
        server.bind(("127.0.0.1", 0))
        if listens:
            server.listen()
        answer = exchange._bus_info(("/x", f"http://127.0.0.1:{server.getsockname()[1]}/"))
    assert answer.error and (answer.outcome.value, answer.tcp_outcome.value) == (outcome, tcp)


def test_names_of_hosts_are_told_with_what_they_mean_here():
    rows = exchange._resolve([{"host": host} for host in ("localhost", "10.9.8.7", "nobody.invalid", "x" * 300)])
    assert [row["addresses"] for row in rows] == [["127.0.0.1"], [], [], []]


def test_of_thousands_of_nodes_some_are_asked():
    nodes = {f"/node{number}": "http://127.0.0.1:1/" for number in range(2500)}
    asked = exchange._sample(nodes)
    assert len(asked) <= exchange.MOST_ASKED and len(asked) > 800
    assert exchange._sample({"/a": "x"}) == {"/a": "x"} and exchange._sample({}) == {}


def test_a_node_that_ended_properly_meanwhile_is_not_silent(ros, served):
    made, master = ros
    master.uris["/base"] = served(Node())
    threading.Timer(0.6, master.uris.pop, ["/dead", None]).start()
    assert looked_at(made)["silent"] == []


def test_connections_with_other_robots(ros, served):
    def end(host):
        return f"TCPROS connection on port 40433 to [{host}:41233 on socket 9]"

    made, master = ros
    # /tool is a node of this roscore on the computer of the other robot, as an operator's tool may be
    master.uris.update({"/other_sync": "http://there:7/"})
    master.uris["/base"] = served(
        Node(
            [1, "http://127.0.0.2:1/", "i", "TCPROS", "/goal", True, end("there")],
            [2, "http://127.0.0.2:9/", "i", "TCPROS", "/x", True, end("127.0.0.2")],
            [3, "/ear", "o", "TCPROS", "/odom", True, end("127.0.0.3")],
            [4, "/dead", "o", "TCPROS", "/odom", True, end("127.0.0.1")],
            [5, "/other_sync", "o", "TCPROS", "/odom", True, end("127.0.0.2")],
            [7, "/nowhere", "o", "TCPROS", "/odom", True],  # before kinetic: nobody knows where
            [6, "http://203.0.113.9:1/", "i", "TCPROS", "/y", True, end("203.0.113.9")],
        )
    )
    found = looked_at(made)["connections"]
    assert [(link["direction"], link["topic"], link["node"], link["peer"], link["robot"]) for link in found] == [
        ("in", "/goal", "/base", "/planner", "two"),
        ("in", "/x", "/base", "http://127.0.0.2:9/", "two"),
        ("out", "/odom", "/base", "/ear", "two"),
    ]


def test_long_names_of_a_robot_cost_others_no_connection(monkeypatch):
    """Any node may subscribe by a name of any length, and an answer of more than 16 Mi characters would be refused."""
    long = [
        [number, f"/{number}{'x' * 60000}", "o", "TCPROS", "/odom", True, " to [there:1 on socket 9"]
        for number in range(30)
    ]
    answers = exchange.BusInfo(
        [*long, [99, "/ear", "o", "TCPROS", "/odom", True, " to [third:1 on socket 9"]], exchange.Outcome.ANSWERED
    )
    monkeypatch.setattr(exchange, "_bus_info", lambda item: answers)
    third = {"name": "third", "address": "127.0.0.5", "discovery_address": "", "robot": "three"}
    nodes = {f"/node{number}": "http://127.0.0.1:1/" for number in range(12)}
    found, _silent, _asked = exchange._connections(nodes, {}, exchange.HostRobots([*MEMBERS, third]), "here")
    assert len(json.dumps(found)) < 3 << 20
    assert [link["node"] for link in found if link["robot"] == "three"] == sorted(nodes)


def test_the_names_of_strange_hosts_are_looked_up_at_once(ros, served, monkeypatch):
    made, master = ros
    hosts = [f"camera{number}" for number in range(12)]
    ends = [f"TCPROS connection on port 40433 to [{host}:41233 on socket 9]" for host in hosts]
    links = [[number, f"/{number}", "o", "TCPROS", "/odom", True, end] for number, end in enumerate(ends)]
    master.uris["/base"] = served(Node(*links))
    asked = threading.Barrier(len(hosts), timeout=4)

    def resolve(name):
        asked.wait()  # a name server that is not there
        return (["127.0.0.2"], "") if name == "camera7" else ([], "no such name")

    monkeypatch.setattr(exchange.network, "resolve", resolve)
    assert [link["peer"] for link in looked_at(made)["connections"]] == ["/7"]


def synced_by(uri):
    return provider(head(md5sum=GET_SYNC_INFO), answer(rows(synced(uri, "/planner", "http://127.0.0.2:1/"))))


def test_another_implementation_is_asked_by_its_service(ros):
    made, master = ros
    master.imports = None
    with synced_by("http://other:1/") as master.sync:
        assert [entry["master"] for entry in looked_at(made)["imports"]] == ["http://other:1/"]


def test_the_sync_node_of_another_robot_is_not_asked(ros):
    made, master = ros
    master.imports, master.sync = None, "rosrpc://198.51.100.2:1"
    assert "no master_sync reports its registrations" in looked_at(made)["error"]


@pytest.mark.slow
@pytest.mark.parametrize(
    "said",
    [
        "[" * 100000,
        '{"imports": ["x"]}',
        '{"imports": {"http://there:11311/": "x"}}',
        '{"imports": {"http://there:11311/": {"/planner": 1}}}',
        '{"imports": {}, "x": ' + "9" * 1000000 + "0" * 20,
    ],
)
def test_a_parameter_that_anybody_has_set_is_no_answer(ros, said):
    made, master = ros
    master.getParam = lambda caller, name: (1, "", said)
    with synced_by(THERE) as master.sync:
        assert [part["master"] for part in looked_at(made)["imports"]] == [THERE]


def test_without_an_answer_of_it_there_is_a_sentence(ros):
    made, master = ros
    master.imports = None
    with provider(head(md5sum="0", type="strange/GetSyncInfo")) as master.sync:
        found = looked_at(made)
    assert "get_sync_info is of the type strange/GetSyncInfo" in found["error"]
    assert found["topics"] == []


@pytest.mark.slow
def test_without_the_python_of_ros_only_the_sums_are_missing(ros):
    made, _master = ros
    path = pathlib.Path(made.file).parent / "python"
    path.write_text("#!/bin/sh\necho 'ImportError: no roslib' >&2; exit 1\n")
    found = looked_at(made)
    assert found["error"] == "" and "ImportError" in found["types_error"] and found["types_outcome"] == "failed"
    assert [topic["md5sum"] for topic in found["topics"]] == ["", ""]
    (pathlib.Path(made.file).parent / "rostopic").unlink()
    found = looked_at(made)
    assert found["error"] == "" and "there is no command rostopic" in found["types_error"] and found["topics"]


@pytest.mark.slow
def test_a_python_of_ros_that_is_late_has_not_failed(ros, monkeypatch):
    made, _master = ros
    (pathlib.Path(made.file).parent / "python").write_text("#!/bin/sh\nsleep 60\n")
    monkeypatch.setattr(exchange, "TYPES", 0.5)
    found = looked_at(made)
    assert (found["error"], found["types_outcome"]) == ("", "no_answer") and found["types_error"]


def test_types_that_are_none_are_a_sentence(ros, monkeypatch):
    monkeypatch.setattr(Master, "getTopicTypes", lambda self, caller: (1, "", ["/odom"]))
    assert looked_at(ros[0])["error"]


def test_a_roscore_that_is_not_there(tmp_path):
    (tmp_path / "environment").write_text("ROS_MASTER_URI=http://127.0.0.1:1\n")
    found = looked_at(probe_ros.Ros(str(tmp_path / "environment")))
    assert "127.0.0.1:1" in found["error"] and found["topics"] == found["imports"] == []


def test_nodes_of_a_roscore_that_is_not_there(tmp_path):
    (tmp_path / "environment").write_text("ROS_MASTER_URI=http://127.0.0.1:1\n")
    with pytest.raises(OSError, match=r"^http://127\.0\.0\.1:1: Connection refused$"):
        exchange.node_uris(probe_ros.Ros(str(tmp_path / "environment")))


def test_the_program_itself(monkeypatch, capsys):
    """With the parts of ROS that it asks pretended: one type has a class, one has none, one breaks when it is imported."""

    def message_class(name):
        if name == "broken/Type":
            raise SyntaxError
        return types.SimpleNamespace(_md5sum="992c") if name == "std_msgs/String" else None

    roslib = types.SimpleNamespace(message=types.SimpleNamespace(get_message_class=message_class))
    ended = []
    for name, module in {"roslib": roslib, "roslib.message": roslib.message}.items():
        monkeypatch.setitem(sys.modules, name, module)
    monkeypatch.setattr(message_types.os, "_exit", ended.append)
    monkeypatch.setattr(sys, "stdin", io.StringIO('["std_msgs/String", "none/None", "broken/Type"]'))
    message_types.main()
    assert json.loads(capsys.readouterr().out) == {"std_msgs/String": "992c"}
    assert ended == [0]


# As rospy and roscpp answer getBusInfo; the last one as before kinetic.
BUS_INFO = [
    [
        1,
        "http://kobuki2computer:41233/",
        "i",
        "TCPROS",
        "/goal",
        True,
        "TCPROS connection on port 40433 to [kobuki2computer:41233 on socket 9]",
    ],
    [2, "/planner", "o", "TCPROS", "/odom", 1, "TCPROS connection on port 39281 to [192.168.1.239:40233 on socket 10]"],
    [3, "http://Kobuki2Computer:41233/", "i", "TCPROS", "/old", 1],
    [4, "/rosout", "o", "TCPROS", "/rosout", 1],
]


def test_links_of_a_node():
    assert [tuple(link.values()) for link in exchange.links(BUS_INFO)] == [
        (1, "in", "/goal", "http://kobuki2computer:41233/", "kobuki2computer"),
        (2, "out", "/odom", "/planner", "192.168.1.239"),
        (3, "in", "/old", "http://Kobuki2Computer:41233/", "kobuki2computer"),
        (4, "out", "/rosout", "/rosout", ""),
    ]


@pytest.mark.slow
@pytest.mark.parametrize("piece", [" to [", " to [:", " to [:1 on", ":1 on socket to ["])
def test_a_long_text_of_a_stranger_is_read_at_once(piece):
    began = time.process_time()
    (link,) = exchange.links([[1, "/x", "o", "TCPROS", "/odom", True, piece * (2_000_000 // len(piece))]])
    assert time.process_time() - began < 20 and len(link["host"]) < 256


nonsense = st.recursive(
    st.none() | st.integers() | st.text(max_size=9), lambda inner: st.lists(inner, max_size=8), max_leaves=20
)


@given(nonsense)
def test_any_bus_info_is_read(answer):
    exchange.links(answer)


def test_nodes_of_others_to_whose_port_no_connection_opens_are_told(ros):
    made, roscore = ros
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        listener.listen(5)
        port = listener.getsockname()[1]
        roscore.uris.update({"/planner": "http://127.0.0.2:1/", "/eye": f"http://127.0.0.1:{port}/"})
        roscore.imports = {THERE: {"/planner": "http://127.0.0.2:1/", "/eye": f"http://127.0.0.1:{port}/"}}
        (row,) = looked_at(made)["unreached"]
    assert (row["node"], row["host"], row["port"], row["outcome"]) == ("/planner", "127.0.0.2", 1, "refused")


def test_of_thousands_of_nodes_of_others_some_are_tried(monkeypatch):
    tried = []
    monkeypatch.setattr(
        exchange, "connect", lambda host, port, _patience: tried.append(port) or PortAnswer(Outcome.OPEN, None, 1.0, "")
    )
    nodes = {f"/node{number}": f"http://127.0.0.2:{2000 + number}/" for number in range(9000)}
    assert exchange._try_imported({**nodes, "/odd": "http://[::1", "/none": ""}) == []
    assert 0 < len(tried) <= exchange.MOST_TRIED


def test_one_service_elsewhere_is_told_beside_others_at_home(monkeypatch):
    at_home, elsewhere = "rosrpc://here:5", "rosrpc://192.0.2.9:5"
    monkeypatch.setattr(
        exchange,
        "_look_up",
        lambda _ros, _method, names: {name: elsewhere if name == "/a/set" else at_home for name in names},
    )
    services = {"/a/get": ["/a"], "/a/set": ["/a"], "/a/zero": ["/a"], "/b/get": ["/b"], "/c": ["/planner"]}
    found = exchange._service_uris(None, {"/a": "http://here:1/", "/b": "http://here:2/"}, services)
    assert found == {"/a": elsewhere, "/b": at_home}
