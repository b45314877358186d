# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The facts of roscores and their nodes: over real sockets, with a roscore as far as it is asked, and with strangers."""

import contextlib
import http.server
import os
import socket
import threading
import xmlrpc.server

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.ros_client import facts, xml_rpc
from provider import GET_SYNC_INFO, LIST_MASTERS, answer, head, master, provider, rows, synced

THERE = "http://there:11311/"


class Roscore:
    """A roscore with one discovery and one sync node."""

    def __init__(self):
        self.uri, self.parameters, self.places = "", {}, {}

    def getUri(self, caller):
        return 1, "", self.uri

    def getPid(self, caller):
        return 1, "", 4711

    def getParam(self, caller, name):
        return (1, "", self.parameters[name]) if name in self.parameters else (-1, "not set", 0)

    def getSystemState(self, caller):
        services = [[name, ["/" + name.split("/")[-2]]] for name in self.places] + [["/base/reset", ["/base"]]]
        return 1, "", [[["/odom", ["/base"]]], [["/odom", ["/ear"]], ["/goal", ["/base"]]], services]

    def lookupService(self, caller, name):
        return 1, "", self.places[name]


class Bundled:
    def getOutsiders(self):
        return ["", []]


@contextlib.contextmanager
def served(instance, place=("127.0.0.1", 0)):
    server = xmlrpc.server.SimpleXMLRPCServer(place, logRequests=False, allow_none=True)
    server.register_instance(instance)
    thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.05})
    thread.start()
    try:
        yield server.server_address[1]
    finally:
        server.shutdown()
        thread.join()
        server.server_close()


def seen(*ports):
    return facts.masters([{"protocol": "tcp", "port": port} for port in ports])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("node", "implementation", "messages"),
    [
        (Bundled(), "bundled", "fkie_multimaster_msgs"),
        (object(), "upstream", "fkie_multimaster_msgs"),
        (object(), "fkie_mas", "fkie_mas_msgs"),
    ],
)
def test_a_roscore_and_its_nodes(node, implementation, messages):
    roscore = Roscore()
    with contextlib.ExitStack() as running:
        port = running.enter_context(served(roscore))
        monitor = f"http://127.0.0.1:{running.enter_context(served(node))}"
        roscore.uri = f"http://here:{port}/"
        listed = rows(master("here", f"http://here:{port}", True, monitor), master("there", THERE, False))
        imported = rows(synced(THERE, "/base", "http://there:1/"))
        for name, md5sum, content in (
            ("/master_discovery/list_masters", LIST_MASTERS, listed),
            ("/master_sync/get_sync_info", GET_SYNC_INFO, imported),
        ):
            kind = {LIST_MASTERS: "DiscoverMasters", GET_SYNC_INFO: "GetSyncInfo"}[md5sum]
            first = head(md5sum=md5sum, type=f"{messages}/{kind}")
            roscore.places[name] = running.enter_context(provider(first, answer(content)))
        roscore.parameters = {
            "/run_id": "2bb5",
            "/rosversion": "1.15.15\n",
            "/master_discovery/mcast_group": "226.0.0.0",
            "/master_discovery/mcast_port": 11511,
            **({facts.IMPORTS: "{}"} if implementation == "bundled" else {}),
        }
        (found,) = seen(port)
    assert found["process"]["pid"] == os.getpid()
    assert (found["port"], found["uri"], found["pid"], found["run_id"]) == (port, roscore.uri, 4711, "2bb5")
    assert (found["rosversion"], found["rosdistro"], found["error"]) == ("1.15.15", "", "")
    assert (found["nodes"], found["topics"], found["services"]) == (4, 2, 3)
    (discovery,), (sync,) = found["discovery"], found["sync"]
    assert (discovery["node"], discovery["uri"], discovery["error"]) == ("/master_discovery", monitor, "")
    assert (discovery["group"], discovery["group_port"]) == ("226.0.0.0", 11511)
    assert [(entry["name"], entry["online"]) for entry in discovery["masters"]] == [("here", True), ("there", False)]
    assert discovery["implementation"] == sync["implementation"] == implementation
    assert sync["imports"] == [{"master": THERE, "nodes": 1, "topics": 1, "services": 1}]


def test_nodes_that_do_not_tell_are_a_sentence():
    roscore = Roscore()
    roscore.places = {
        "/a/master_discovery/list_masters": "http://x",
        "/master_sync/get_sync_info": "rosrpc://127.0.0.1:1",
    }
    with served(roscore) as port:
        (found,) = seen(port)
    (discovery,), (sync,) = found["discovery"], found["sync"]
    assert "no address of a service" in discovery["error"] and "refused" in sync["error"]
    assert (discovery["implementation"], discovery["masters"], sync["imports"]) == ("", [], [])


def test_nodes_of_another_robot_are_not_told_as_own():
    """Its sync node has registered them here."""
    roscore = Roscore()
    roscore.places = {
        "/mas_discovery/list_masters": "rosrpc://198.51.100.2:1",
        "/mas_sync/get_sync_info": "rosrpc://198.51.100.2:1",
    }
    with served(roscore) as port:
        (found,) = seen(port)
    assert (found["discovery"], found["sync"], found["services"]) == ([], [], 3)


class Page(http.server.BaseHTTPRequestHandler):
    def do_POST(self):
        self.send_error(404)

    def log_message(self, *words):
        pass


class Evil(Roscore):
    def getUri(self, caller):
        return 1, "", "evil\u202e" + "x" * 9999

    def getPid(self, caller):
        return 1, "", "many"

    def getSystemState(self, caller):
        return 1, "", [[["/a", 5]], [], []]


def test_something_else_than_a_roscore_is_left_out():
    server = http.server.HTTPServer(("127.0.0.1", 0), Page)
    threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.05}, daemon=True).start()
    with served(Bundled()) as other, served(Evil()) as evil:
        assert seen(server.server_address[1], other, evil, 1) == []
    server.shutdown()
    server.server_close()


@pytest.mark.parametrize("addresses", [("127.0.0.1", "127.0.0.77"), ("127.0.0.77", "127.0.0.1")], ids=str)
def test_a_roscore_is_found_beside_another_program_on_its_port(addresses):
    with served(Roscore(), (addresses[0], 0)) as port, served(Bundled(), (addresses[1], port)):
        (found,) = seen(port)
    assert (found["pid"], found["error"]) == (4711, "")


def test_a_program_that_has_ended_meanwhile_is_left_out(monkeypatch):
    with served(Roscore()) as port:
        here = facts.ports.holders([{"protocol": "tcp", "port": port}])
    monkeypatch.setattr(facts.ports, "holders", lambda wanted, proc: here)
    assert len(here) == 1 and seen(port) == []


def test_a_roscore_that_refuses_and_still_listens_is_told(monkeypatch):
    def refuse(*words):
        raise OSError("Connection refused")

    monkeypatch.setattr(facts, "ask", refuse)
    with served(Roscore()) as port:
        (found,) = seen(port)
    assert "refused" in found["error"]


def test_a_roscore_that_hangs_has_an_entry(monkeypatch):
    monkeypatch.setattr(xml_rpc, "CALL", 0.3)
    with socket.create_server(("127.0.0.1", 0)) as silent:
        (found,) = seen(silent.getsockname()[1])
    assert found["error"].startswith("http://127.0.0.1") and found["process"]["pid"] == os.getpid()


def test_texts_of_a_roscore_are_plain():
    class Odd(Evil):
        getSystemState = Roscore.getSystemState

    with served(Odd()) as port:
        (found,) = seen(port)
    assert "\u202e" not in found["uri"] and len(found["uri"]) <= 200
    assert found["pid"] == 0
