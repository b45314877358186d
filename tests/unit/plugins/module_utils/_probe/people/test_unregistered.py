# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Nodes that are registered at no roscore: real processes that answer as nodes do, and a roscore that knows them or not."""

import contextlib
import os
import subprocess
import sys
import tempfile
import time

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.people import unregistered
from talking import Roscore, served

MEMBERS = [{"name": "here-pc", "robot": "one", "address": "192.168.11.2", "discovery_address": "192.168.1.2"}]
#: answers as the process's last word says: a node with these topics, rosmaster or roslaunch, a web server, or never
PROGRAM = """
import http.server, json, os, socket, sys, xmlrpc.server
log = open(os.environ["ROS_LOG_DIR"] + "/driver.log", "w") if "ROS_LOG_DIR" in os.environ else None
kind, topics = sys.argv[-1].partition(" ")[::2]
if kind == "silent":
    server = socket.create_server(("127.0.0.1", 0))
elif kind == "web":
    server = http.server.HTTPServer(("127.0.0.1", 0), http.server.SimpleHTTPRequestHandler)
else:
    server = xmlrpc.server.SimpleXMLRPCServer(("127.0.0.1", 0), logRequests=False)
    if kind != "other":
        code = 1 if kind == "node" else 0
        server.register_function(lambda caller: [code, "publications", json.loads(topics)], "getPublications")
port = server.socket.getsockname()[1] if hasattr(server, "socket") else server.getsockname()[1]
print(port, flush=True)
server.serve_forever() if hasattr(server, "serve_forever") else sys.stdin.read()
"""
TOPICS = '[["/rosout", "rosgraph_msgs/Log"], ["/battery", "std_msgs/Float32"]]'


@pytest.fixture(autouse=True)
def _soon(monkeypatch):
    monkeypatch.setattr(unregistered, "LEAST_AGE", -1.0)
    monkeypatch.setattr(unregistered, "SETTLES", 0.0)


@contextlib.contextmanager
def _run(uri, answer, *words, log=True):
    """A process of ROS that answers so, and keeps a log open as nodes do; its port."""
    folder = tempfile.TemporaryDirectory()
    logs = {"ROS_LOG_DIR": folder.name} if log else {}
    process = subprocess.Popen(
        [sys.executable, "-c", PROGRAM, *words, answer],
        env={"PATH": os.environ["PATH"], "ROS_MASTER_URI": uri, "ROS_HOSTNAME": "here-pc", **logs},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
    )
    try:
        yield int(process.stdout.readline())
    finally:
        process.kill()
        process.communicate()
        folder.cleanup()


def _know(roscore, port):
    """Have a port registered, for whatever host."""
    roscore.publishers.setdefault("/rosout", {})[f"/node{port}"] = f"http://another-host:{port}/"


def _look(uri):
    ros = unregistered.Ros("/nowhere", {"ROS_MASTER_URI": uri})
    return unregistered.find_unregistered(ros, MEMBERS, "here-pc", uri)


def _find(answer, *words, is_known=False):
    roscore = Roscore()
    with served(roscore) as uri, _run(uri, answer, *words) as port:
        if is_known:
            _know(roscore, port)
        found = _look(uri)
    return found, port


def test_a_node_without_a_registration_is_told():
    found, port = _find(f"node {TOPICS}", "__name:=driver")
    (row,) = found["nodes"]
    assert (row["node"], row["topics"], row["ports"], row["starter"]) == ("driver", ["/battery"], [port], "shell")
    assert row["pid"] > 1 and (found["unknown"], found["asked"]) == (1, 1)


def test_a_registered_node_is_not_even_asked():
    found, _port = _find(f"node {TOPICS}", is_known=True)
    assert found == {"nodes": [], "unknown": 0, "asked": 0}


@pytest.mark.parametrize(
    "answer", ["other", "web", "silent", f"refusing {TOPICS}", "node 7", 'node [["/a"]]', "node {}"]
)
def test_another_program_is_no_node(answer):
    found, _port = _find(answer)
    assert found["nodes"] == [] and found["asked"] == 1


def test_a_program_without_a_sign_of_a_node_is_never_asked():
    """One that takes a single connection would lose it."""
    with served(Roscore()) as uri, _run(uri, f"node {TOPICS}", log=False):
        assert _look(uri) == {"nodes": [], "unknown": 0, "asked": 0}


def test_its_topics_are_bounded_and_plain():
    found, _port = _find(
        'node [["/\\u202e&", "x"], ["' + "/long" * 999 + '", "x"], ["/c", ""], ["/d", ""], ["/e", ""], [7, ""]]'
    )
    (row,) = found["nodes"]
    assert len(row["topics"]) == unregistered.MOST_TOPICS
    assert all(len(topic) <= 300 and topic.isprintable() for topic in row["topics"])


def test_a_young_process_may_be_about_to_register(monkeypatch):
    monkeypatch.setattr(unregistered, "LEAST_AGE", 30.0)
    assert _find(f"node {TOPICS}")[0] == {"nodes": [], "unknown": 0, "asked": 0}


def test_a_node_that_registers_meanwhile_is_none(monkeypatch):
    roscore = Roscore()
    with served(roscore) as uri, _run(uri, f"node {TOPICS}") as port:
        monkeypatch.setattr(unregistered.time, "sleep", lambda _seconds: _know(roscore, port))
        assert _look(uri) == {"nodes": [], "unknown": 1, "asked": 1}


def test_without_an_answer_of_the_roscore_nothing_is_told():
    with _run("http://127.0.0.1:9/", f"node {TOPICS}"):
        assert _look("http://127.0.0.1:9/")["unknown"] == 0


def test_a_node_of_another_roscore_is_not_asked():
    with served(Roscore()) as uri, _run("http://elsewhere:11311/", f"node {TOPICS}"):
        assert _look(uri) == {"nodes": [], "unknown": 0, "asked": 0}


def test_of_many_processes_a_sample_is_asked_within_a_limit(monkeypatch):
    monkeypatch.setattr(unregistered, "MOST_ASKED", 2)
    with contextlib.ExitStack() as stack:
        uri = stack.enter_context(served(Roscore()))
        for _number in range(5):
            stack.enter_context(_run(uri, "silent"))
        began = time.monotonic()
        found = _look(uri)
    assert (found["unknown"], found["asked"]) == (5, 2) and time.monotonic() - began < unregistered.LONGEST_ROUND
