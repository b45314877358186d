# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""master_sync, with real XML-RPC to a roscore, a discovery and nodes that this file plays; only rospy is not there."""

import importlib
import socket
import sys
import threading
import time
import types
from functools import partial

import rosfleet_multimaster
from rosfleet_multimaster.edge.process import program
from rosfleet_multimaster.edge.rpc_server import RefusedCall, RpcServer
from rosfleet_multimaster.protocol.messages import AnnouncedMaster

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
        methods = {"system.multicall": self.multicall, "getUri": lambda caller: [1, "", self.uri]}
        self.server, self.uri = serve({**methods, "getSystemState": partial(self.call, "getSystemState")})

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
            value = answers[method](*arguments)
            return [1, "", 0 if value is None else value]
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
        return AnnouncedMaster("robot2", self.uri, self.monitor_uri, DISCOVERY, self.stamp, self.stamp, online)


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
        self.nodes, self.asked_list, self.on_signal = [], [], None
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
        ros.ListMasters = lambda: self.ask_for_list
        monkeypatch.setitem(sys.modules, "rosfleet_multimaster.edge.ros", ros)
        monkeypatch.setattr(rosfleet_multimaster.edge, "ros", ros, raising=False)
        monkeypatch.delitem(sys.modules, "rosfleet_multimaster.master_sync", raising=False)
        monkeypatch.setattr(program, "on_signals", self.take_signals)
        monkeypatch.setattr(program, "leave_process", lambda status: None)
        monkeypatch.setattr(sys, "argv", ["master_sync"])
        self.module, self.program = importlib.import_module("rosfleet_multimaster.master_sync"), None

    def take_signals(self, _loop, end):
        """Signals are for the main thread, which is the test's: `end` is called by it."""
        self.on_signal = end

    def ask_for_list(self, service):
        """A test may have another answer by then."""
        return self.list_masters(service)

    def list_masters(self, service):
        """The answer of this robot's discovery."""
        self.asked_list.append(service)
        return list(self.listed)

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
        self.changed(AnnouncedMaster("robot1", self.roscore.uri, "", "", time.monotonic(), time.monotonic(), True))

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
        self.program.loop.post(self.on_signal)
        self.thread.join(10)
        for server in [self.roscore.server, *self.other.servers]:
            server.stop()


def until(condition, seconds=60.0):
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, "it does not happen"
        time.sleep(0.01)
