# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""master_sync against upstream's interface, and without upstream's defects.

The numbers in the names are those of the list of upstream's defects (defect_N) and of the checklist for own nodes
(check_B1 ...). The program is the real one, with real XML-RPC to a roscore, a discovery and nodes that this file plays;
only rospy is not there.
"""

import ast
import importlib
import pathlib
import socket
import sys
import threading
import time
import types

import pytest
import rosfleet_multimaster
from rosfleet_multimaster.discovery.rpc_server import RefusedCall, RpcServer
from rosfleet_multimaster.edge import patience
from rosfleet_multimaster.edge.process import program
from rosfleet_multimaster.protocol import parameters
from rosfleet_multimaster.protocol.filters import Filters
from rosfleet_multimaster.protocol.graph import Node, State
from rosfleet_multimaster.protocol.imports import IMPORTS
from rosfleet_multimaster.protocol.messages import Master
from rosfleet_multimaster.sync.core.sync import MISSING, Sync

FOLDER = pathlib.Path(rosfleet_multimaster.__file__).parent
R2 = "http://robot2:11311/"
DISCOVERY, SYNC = "/master_discovery", "/master_sync"


def serve(methods):
    """An XML-RPC server on a free port of the loopback interface, and its URI."""
    server = RpcServer("127.0.0.1", 0, methods, lambda host, why: None)
    return server, f"http://127.0.0.1:{server.server_address[1]}/"


class Roscore:
    """A roscore: registrations, parameters, and which nodes it would shut down."""

    def __init__(self):
        self.nodes, self.types, self.parameters = {}, {}, {}
        self.tables = {"Publisher": {}, "Subscriber": {}, "Service": {}}
        self.service_uris, self.shut_down, self.calls = {}, [], []
        self.fail = 0  # so many requests with registrations are refused
        self.before = lambda method, arguments: None
        self.server, self.uri = serve({"system.multicall": self.multicall, "getUri": lambda caller: [1, "", self.uri]})

    def multicall(self, calls):
        if self.fail and any("register" in call["methodName"].lower() for call in calls):
            self.fail -= 1
            raise RefusedCall("busy")
        return [[self.call(call["methodName"], *call["params"])] for call in calls]

    def call(self, method, caller, *arguments):
        if "egister" in method:
            self.before(method, arguments)
            self.calls.append((method, caller, *arguments))
            return [1, "", self.register(method, caller, *arguments)]
        answers = {
            "getPid": lambda: 4711,
            "getTopicTypes": lambda: [[topic, kind] for topic, kind in self.types.items()],
            "getSystemState": lambda: [[[n, sorted(t[n])] for n in t if t[n]] for t in self.tables.values()],
            "lookupNode": lambda node: self.nodes[node],
            "lookupService": lambda service: self.service_uris[service],
            "getParam": lambda name: self.parameters[name],
            "setParam": self.parameters.__setitem__,
            "deleteParam": lambda name: self.parameters.pop(name, 0) and 0,
        }
        try:
            return [1, "", answers[method](*arguments) or 0]
        except KeyError:
            return [-1, "unknown", 0]

    def register(self, method, node, name, *rest):
        kind = method.split("egister")[1]
        users = self.tables[kind].setdefault(name, set())
        if method.startswith("un"):
            users.discard(node)
            return 1
        uri = rest[-1]
        if self.nodes.get(node, uri) != uri:
            self.shut_down.append(self.nodes[node])
        self.nodes[node] = uri
        users.add(node)
        if kind == "Service":
            self.service_uris[name] = rest[0]
        elif rest[0] != "*":
            self.types[name] = rest[0]
        return sorted(self.nodes[user] for user in self.tables["Publisher"].get(name, ()))

    def made(self, node):
        """The calls that were made for a node."""
        return [call for call in self.calls if call[1] == node]


class Recorder(dict):
    """Methods that are not there, and which of them were asked for."""

    def get(self, name, default=None):
        self[name] = True
        return default


class Other:
    """Another robot: its discovery, one node with an XML-RPC server, and a roscore that nobody is to call."""

    def __init__(self):
        self.updates, self.types = [], {"/chatter": "std_msgs/String"}
        self.publishers, self.subscribers = {"/chatter": ["/talker"]}, {}
        self.nodes, self.stamp, self.fault, self.asked = {}, 1.0, False, []
        node, self.node_uri = serve({"publisherUpdate": lambda *call: self.updates.append(call) or [1, "", 0]})
        roscore, self.uri = serve({})
        roscore.methods = self.roscore_calls = Recorder()
        discovery, self.monitor_uri = serve({"masterInfoFiltered": self.info, "getTopicsMd5sum": lambda names: []})
        self.servers = [node, roscore, discovery]

    def info(self, wire):
        self.asked.append(wire)
        if self.fault:
            raise RefusedCall("no state")
        nodes = {name: self.nodes.get(name, self.node_uri) for name in ("/talker", "/hearer")}
        rows = [[name, uri, self.uri, None, "local"] for name, uri in nodes.items()]
        tables = [[[n, users] for n, users in table.items()] for table in (self.publishers, self.subscribers)]
        stamp = f"{self.stamp:.9f}"
        return [stamp, stamp, self.uri, "robot2", *tables, [], [[t, k] for t, k in self.types.items()], rows, []]

    def announced(self, online=True):
        return Master("robot2", self.uri, self.monitor_uri, DISCOVERY, self.stamp, self.stamp, online)


class SyncNode:
    """The part of rospy that the program uses."""

    def __init__(self, roscore, held):
        self.held, self.callback, self.topic = held, None, ""
        roscore.call("registerService", SYNC, f"{SYNC}/get_sync_info", "rosrpc://own:1", "http://own:1/")

    def service_uri(self):
        return f"{SYNC}/get_sync_info", "rosrpc://own:1"

    def subscribe(self, topic, callback):
        self.topic, self.callback = topic, callback


class Diagnostics:
    """The topic /diagnostics, to which nobody listens: what changed is published all the same."""

    def __init__(self):
        self.diagnoses = []

    def has_listeners(self):
        return False

    def publish(self, parts, now, robot):
        self.diagnoses.append(parts)


class Lab:
    """The running program and what is around it."""

    def __init__(self, monkeypatch, tmp_path):
        self.roscore, self.other, self.listed = Roscore(), Other(), []
        self.discovery = socket.create_server(("127.0.0.1", 0))  # it is alive, and that is all
        self.discovery_uri = f"http://127.0.0.1:{self.discovery.getsockname()[1]}/"
        self.discovered(DISCOVERY, f"{DISCOVERY}/changes", "x/MasterState")
        self.nodes, self.asked_list = [], []
        self.listed = [self.other.announced()]
        ros = types.ModuleType("rosfleet_multimaster.edge.ros")
        ros.master_uri = lambda: self.roscore.uri
        ros.node_name = lambda default: SYNC
        ros.start = lambda default: (SYNC, "http://own:1/")
        ros.on_shutdown = ros.stop = lambda reason: None
        ros.md5sum = lambda name: None
        self.diagnostics = Diagnostics()
        ros.Diagnostics = lambda: self.diagnostics
        ros.SyncNode = lambda held: self.nodes.append(SyncNode(self.roscore, held)) or self.nodes[-1]
        ros.ListMasters = lambda: lambda service: self.asked_list.append(service) or list(self.listed)
        monkeypatch.setitem(sys.modules, "rosfleet_multimaster.edge.ros", ros)
        monkeypatch.setattr(rosfleet_multimaster.edge, "ros", ros, raising=False)
        monkeypatch.delitem(sys.modules, "rosfleet_multimaster.master_sync", raising=False)
        monkeypatch.setattr(program, "on_signals", lambda loop, end: None)
        monkeypatch.setattr(program, "leave_process", lambda status: None)
        monkeypatch.setattr(sys, "argv", ["master_sync"])
        self.module, self.program = importlib.import_module("rosfleet_multimaster.master_sync"), None

    def discovered(self, node, topic, kind):
        """Register a discovery node."""
        self.roscore.call("registerPublisher", node, topic, kind, self.discovery_uri)
        self.roscore.call("registerService", node, f"{node}/list_masters", "rosrpc://own:2", self.discovery_uri)

    def start(self):
        def made(start):
            self.program = program_class(start)
            return self.program

        program_class, self.module.MasterSync = self.module.MasterSync, made
        self.thread = threading.Thread(target=self.module.main, daemon=True)
        self.thread.start()
        until(lambda: self.nodes and self.nodes[0].callback)
        return self

    def own(self, method, *arguments):
        """Let an own node do something; the discovery of this robot says that something has changed."""
        self.roscore.call(method, *arguments)
        self.changed(Master("robot1", self.roscore.uri, "", "", time.monotonic(), time.monotonic(), True))

    def changed(self, master):
        self.nodes[0].callback("changed", master)

    def other_changes(self):
        self.other.stamp += 1
        self.listed = [self.other.announced()]
        self.changed(self.other.announced())

    def warnings(self):
        """The entries of /diagnostics that are no OK."""
        return [entry for entry in (self.diagnostics.diagnoses or [[]])[-1] if entry.level]

    def has(self, kind, name, node):
        return node in self.roscore.tables[kind].get(name, ())

    def end(self):
        self.program.loop.post(self.program._end)
        self.thread.join(10)
        for server in [self.roscore.server, *self.other.servers]:
            server.stop()


def until(condition, seconds=60.0):
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, "it does not happen"
        time.sleep(0.01)


@pytest.fixture(name="lab")
def _lab(monkeypatch, tmp_path):
    lab = Lab(monkeypatch, tmp_path)
    yield lab
    lab.end()


# The checklist


def test_16_b1_the_service_for_discovery_ends_with_get_sync_info():
    tree = ast.parse((FOLDER / "edge/ros.py").read_text(encoding="utf-8"))
    calls = [
        node for node in ast.walk(tree) if isinstance(node, ast.Call) and getattr(node.func, "attr", "") == "Service"
    ]
    names = {call.args[0].value for call in calls}
    assert "~get_sync_info" in names  # rospy makes its URI from ROS_HOSTNAME, as the roscore does


def test_16_b2_registrations_are_reported_before_they_are_made(lab):
    seen = []

    def before(method, arguments):
        if method == "registerPublisher":
            reported = {(item.name, item.node) for item in lab.nodes[0].held()}
            seen.append(((arguments[0], "/talker") in reported, "/talker" in lab.roscore.parameters[IMPORTS]))

    lab.roscore.before = lambda method, arguments: lab.nodes and before(method, arguments)
    lab.start()
    until(lambda: lab.has("Publisher", "/chatter", "/talker"))
    assert seen == [(True, True)]


def test_16_b3_callers_are_remote_nodes_at_the_own_roscore_only(lab):
    lab.other.subscribers = {"/heard": ["/hearer"]}
    lab.start()
    until(lambda: lab.has("Subscriber", "/heard", "/hearer"))
    uri = lab.other.node_uri
    assert lab.roscore.made("/talker") == [("registerPublisher", "/talker", "/chatter", "std_msgs/String", uri)]
    assert lab.roscore.made("/hearer") == [("registerSubscriber", "/hearer", "/heard", "*", uri)]
    assert lab.other.roscore_calls == {}


def test_16_b4_master_tells_an_imported_subscriber_publishers(lab):
    lab.roscore.call("registerPublisher", "/own", "/heard", "std_msgs/String", "http://127.0.0.1:9/")
    lab.other.subscribers = {"/heard": ["/hearer"]}
    lab.start()
    until(lambda: lab.other.updates)
    assert lab.other.updates == [("/master", "/heard", ["http://127.0.0.1:9/"])]


def test_16_c_discovery_is_known_by_its_type_and_service_names(lab):
    for table in lab.roscore.tables.values():
        table.clear()
    lab.discovered("/zeroconf", "/zeroconf/news", "old_msgs/MasterState")
    lab.start()
    until(lambda: lab.has("Publisher", "/chatter", "/talker"))
    assert lab.nodes[0].topic == "/zeroconf/news" and set(lab.asked_list) == {"/zeroconf/list_masters"}


def test_a_discovery_that_ends_is_asked_again_when_it_returns(lab):
    lab.start()
    until(lambda: lab.asked_list)
    line, _address = lab.discovery.accept()
    lab.discovery.close()
    line.close()
    time.sleep(0.2)
    count = len(lab.asked_list)
    time.sleep(1.2)
    assert len(lab.asked_list) == count
    with socket.create_server(("127.0.0.1", 0)) as another:
        lab.discovery_uri = f"http://127.0.0.1:{another.getsockname()[1]}/"
        lab.discovered(DISCOVERY, f"{DISCOVERY}/changes", "x/MasterState")
        until(lambda: len(lab.asked_list) > count)


# The defects


def test_15_3_a_fault_instead_of_a_state_changes_nothing(lab):
    lab.start()
    until(lambda: lab.has("Publisher", "/chatter", "/talker"))
    lab.other.fault, lab.other.publishers, count = True, {}, len(lab.other.asked)
    lab.other_changes()
    until(lambda: len(lab.other.asked) > count + 1)
    assert lab.has("Publisher", "/chatter", "/talker")
    lab.other.fault = False
    until(lambda: not lab.has("Publisher", "/chatter", "/talker"))


def test_15_4_a_call_that_the_roscore_refused_is_repeated(lab):
    lab.roscore.fail = 2
    started = time.monotonic()
    lab.start()
    until(lambda: lab.has("Publisher", "/chatter", "/talker"))
    assert time.monotonic() - started < 5 and lab.roscore.fail == 0


def test_15_4_what_the_roscore_has_lost_is_registered_again(lab):
    lab.start()
    until(lambda: lab.has("Publisher", "/chatter", "/talker"))
    lab.roscore.tables["Publisher"]["/chatter"].clear()
    lab.own("registerPublisher", "/own", "/other", "std_msgs/String", "http://own:3/")
    until(lambda: lab.has("Publisher", "/chatter", "/talker"))


def test_15_5_a_change_registers_only_the_difference(lab):
    lab.other.subscribers = {"/heard": ["/hearer"]}
    lab.start()
    until(lambda: lab.has("Subscriber", "/heard", "/hearer"))
    before = len(lab.roscore.calls)
    lab.other.subscribers = {"/heard": ["/hearer"], "/more": ["/hearer"]}
    lab.other_changes()
    until(lambda: lab.has("Subscriber", "/more", "/hearer"))
    assert [call[2] for call in lab.roscore.calls[before:]] == ["/more"]


def test_15_5_a_subscriber_that_hangs_delays_no_other(lab):
    release = threading.Event()
    server, uri = serve({"publisherUpdate": lambda *call: release.wait(60) and [1, "", 0]})
    for name in ("/heard", "/later"):
        lab.roscore.call("registerPublisher", "/own", name, "std_msgs/String", "http://127.0.0.1:9/")
    lab.other.nodes = {"/talker": uri}
    lab.other.subscribers = {"/heard": ["/talker"], "/later": ["/hearer"]}
    started = time.monotonic()
    lab.start()
    until(lambda: lab.other.updates)
    assert time.monotonic() - started < 30
    release.set()
    server.stop()


def test_15_6_a_node_with_the_name_of_an_own_one_ends_no_node(lab):
    lab.roscore.call("registerPublisher", "/talker", "/own_topic", "std_msgs/String", "http://own:3/")
    lab.start()
    until(lab.warnings)
    assert lab.roscore.shut_down == [] and lab.roscore.nodes["/talker"] == "http://own:3/"
    assert not lab.has("Publisher", "/chatter", "/talker")
    _limits, names, kinds, _places = lab.diagnostics.diagnoses[-1]
    assert names[2][0][0] == "node /talker" and kinds[2] == []


def test_15_6_a_state_that_comes_during_a_round_waits(lab):
    """Nobody has looked yet whether the names in it are free."""
    lab.roscore.call("registerPublisher", "/talker", "/mine", "std_msgs/String", "http://127.0.0.1:9/")
    answer, waited = lab.roscore.call, []

    def slow(method, *arguments):
        found = answer(method, *arguments)
        if method == "getSystemState" and lab.program.rounds.working and not waited:
            until(lambda: any(remote.state for remote in lab.program.core.remotes.values()))
            waited.append(True)
        return found

    lab.roscore.call = slow
    lab.start()
    until(lambda: lab.program.refused)
    assert waited
    assert [call[2] for call in lab.roscore.made("/talker")] == ["/mine"]


def test_15_7_a_node_on_a_second_computer_is_exchanged(lab):
    lab.other.nodes = {"/talker": "http://robot2-arm:40000/"}
    lab.start()
    until(lambda: lab.has("Publisher", "/chatter", "/talker"))
    assert lab.roscore.nodes["/talker"] == "http://robot2-arm:40000/"


def test_15_8_registrations_are_recorded_outside_of_master_sync(lab):
    lab.start()
    until(lambda: lab.has("Publisher", "/chatter", "/talker"))
    assert lab.other.uri in lab.roscore.parameters[IMPORTS]
    assert {item.node for item in lab.nodes[0].held()} == {"/talker"}


def sync(**values):
    return Sync(Filters(values), "http://robot1:11311/", SYNC, False, bool(values.pop("on_demand", False)), 0.0)


def fetched(core, publishers):
    nodes = {"/talker": Node("http://robot2:40000/", R2, "local")}
    core.take_announcement(Master("robot2", R2, "http://robot2:11611", DISCOVERY, 1.0, 1.0, True), 0.0)
    (fetch,) = core.due(1.0)
    state = State(R2, "robot2", 1.0, 1.0, publishers, types=dict.fromkeys(publishers, "a/B"), nodes=nodes)
    assert core.take_fetch(fetch, state, 1.0)
    return core


def test_15_9_masters_of_one_name_do_not_take_each_other_away():
    core = fetched(sync(), {"/chatter": ("/talker",)})
    core.take_announcement(
        Master("robot2", "http://robot2b:11311/", "http://robot2b:11611", DISCOVERY, 1.0, 1.0, True), 2.0
    )
    core.remove("http://robot2b:11311/")
    assert core.candidates(3.0)
    core.take_list([], 3.0)  # nor does a list that is empty for a moment
    core.take_list([], 3.0 + MISSING / 2)
    assert core.candidates(3.0 + MISSING / 2)


def test_15_10_and_13_no_wall_clock_and_no_process_wide_limit():
    for name in (
        "sync/core/sync",
        "sync/core/message_types",
        "sync/core/losses",
        "master_sync",
        "sync/rounds",
        "edge/process/program",
        "edge/connections",
    ):
        text = (FOLDER / f"{name}.py").read_text(encoding="utf-8")
        assert "time.time" not in text and "setdefaulttimeout" not in text
    text = (FOLDER / "master_sync.py").read_text(encoding="utf-8")
    assert "wall_clock" not in text


def test_15_14_filters_are_parameters_and_no_yaml_file_is_loaded():
    _values, warnings = parameters.overlay(parameters.SYNC, {"interface_url": "file:///x.yaml"})
    assert warnings == ["~interface_url has no effect: filters are parameters here: give the lists themselves"]
    assert not any("import yaml" in path.read_text(encoding="utf-8") for path in FOLDER.rglob("*.py"))


@pytest.mark.parametrize(
    "values", [{"ignore_topics": {"robot2": "/chatter"}}, {"robot2": {"ignore_topics": "/chatter"}}]
)
def test_15_15_a_single_pattern_for_one_host_is_one_pattern(values):
    rules = Filters(values).rules("ROBOT2")
    assert not rules.topic("/n", "/chatter", "a/B", True)
    assert rules.topic("/n", "/c", "a/B", True)


def test_15_16_on_demand_releases_what_nobody_wants_any_more():
    core = fetched(sync(on_demand=True), {"/chatter": ("/talker",), "/map": ("/talker",)})
    assert [item.registration.name for item in core.candidates(2.0, ["/chatter"])] == ["/chatter"]
    assert core.candidates(2.0, []) == []


def test_a_hung_service_of_discovery_does_not_stop_the_exchange():
    forever, started = threading.Event(), time.monotonic()
    for _count in range(6):
        with pytest.raises(TimeoutError):
            patience.run_with_limit(0.05, forever.wait)
    assert time.monotonic() - started < 10
    assert sum(1 for thread in threading.enumerate() if thread in patience._hanging) == 4
    forever.set()
    until(lambda: not any(thread.is_alive() for thread in patience._hanging))
    assert patience.run_with_limit(1.0, lambda: "answer") == "answer"
    with pytest.raises(ZeroDivisionError):
        patience.run_with_limit(1.0, lambda: 1 / 0)


def test_while_a_slow_roscore_is_waited_for_nothing_spins(lab):
    ticks = []
    tick = lab.module.MasterSync._tick
    lab.module.MasterSync._tick = lambda self, now: ticks.append(now) or tick(self, now)
    lab.start()
    until(lambda: lab.has("Publisher", "/chatter", "/talker"))
    answer = lab.roscore.server.methods["system.multicall"]
    lab.roscore.server.methods["system.multicall"] = lambda calls: time.sleep(1.5) or answer(calls)
    time.sleep(0.7)
    ticks.clear()
    time.sleep(2.0)
    lab.roscore.server.methods["system.multicall"] = answer
    assert len(ticks) < 20


def test_a_type_conflict_is_refused_and_both_kinds_are_published(lab):
    node, uri = serve(
        {
            "getPublications": lambda caller: [1, "", []],
            "getSubscriptions": lambda caller: [1, "", [["/chatter", "std_msgs/Int32"]]],
        }
    )
    lab.roscore.call("registerSubscriber", "/own", "/chatter", "std_msgs/Int32", uri)
    lab.start()
    until(lab.warnings)
    _limits, names, kinds, _places = lab.diagnostics.diagnoses[-1]
    assert names[:2] == ("multimaster: names", "OK") and kinds[2][0][0] == "topic /chatter"
    assert not lab.has("Publisher", "/chatter", "/talker")
    lab.own("unregisterSubscriber", "/own", "/chatter", uri)
    until(lambda: lab.has("Publisher", "/chatter", "/talker"))
    until(lambda: not lab.warnings())  # it is said when all calls have been answered
    node.stop()
