# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""What a computer sees of others: real sockets, real packets, in network namespaces where there must be two hosts."""

import json
import os
import pathlib
import socket
import subprocess
import sys
import threading
import time
import types
import xmlrpc.server

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._verify import listener as probe_listener
from ansible_collections.rosfleet.multimaster.plugins.module_utils._verify import network
from ansible_collections.rosfleet.multimaster.plugins.module_utils._verify import ros as probe_ros

root = pytest.mark.skipif(os.geteuid() != 0, reason="raw sockets and namespaces need root")

PING = """
import json, sys
from ansible_collections.rosfleet.multimaster.plugins.module_utils._verify import network
pings = network.ping(sys.argv[1:], tries=2, answer=0.4)
print(json.dumps([pings, [network.way(address) for address in sys.argv[1:]]]))
"""


@pytest.fixture
def hosts():
    """Two hosts, 10.99.0.1 and 10.99.0.2, on one wire."""
    names = [f"probe{os.getpid()}{side}" for side in "ab"]
    commands = [f"ip netns add {name}" for name in names]
    commands += [
        f"ip -n {names[0]} link add eth0 type veth peer name eth0 netns {names[1]}",
        *(f"ip -n {name} address add 10.99.0.{number}/24 dev eth0" for number, name in enumerate(names, 1)),
        *(f"ip -n {name} link set {link} up" for name in names for link in ("lo", "eth0")),
    ]
    try:
        for command in commands:
            subprocess.run(command.split(), check=True)
        yield names
    finally:
        for name in names:
            subprocess.run(["ip", "netns", "delete", name], check=False)


@root
def test_ping_between_two_hosts(hosts):
    collections = str(pathlib.Path(network.__file__).parents[6])
    output = subprocess.run(
        ["ip", "netns", "exec", hosts[0], sys.executable, "-c", PING, "10.99.0.2", "10.99.0.3", "10.98.0.1"],
        check=True,
        stdout=subprocess.PIPE,
        env={**os.environ, "PYTHONPATH": collections},
    ).stdout
    pings, ways = json.loads(output)
    assert pings["10.99.0.2"]["ok"] and 0 < pings["10.99.0.2"]["rtt_ms"] < 400
    assert not pings["10.99.0.3"]["ok"] and pings["10.99.0.3"]["error"]
    assert pings["10.98.0.1"]["error"] == "Network is unreachable"
    assert ways[0] == {"device": "eth0", "source": "10.99.0.1", "gateway": None, "metric": None, "error": ""}
    assert ways[2]["device"] is None and "unreachable" in ways[2]["error"]


@root
def test_ping_of_nobody_and_of_this_computer():
    assert network.ping([]) == {}
    assert network.ping(["127.0.0.1"])["127.0.0.1"]["ok"]


def test_resolve():
    assert network.resolve("localhost") == (["127.0.0.1"], "")
    addresses, error = network.resolve("no.such.name.invalid")
    assert addresses == [] and error
    assert network.resolve("a" * 70)[0] == []  # a label that no resolver takes


def test_concurrently_keeps_the_order_and_leaves_the_late_behind():
    began = time.monotonic()
    results = network.concurrently(lambda item: time.sleep(item) or item, [0.2, 0, 60, 0.1], 2.0, lambda item: "late")
    assert results == [0.2, 0, "late", 0.1]
    assert time.monotonic() - began < 30


def test_concurrently_does_not_hide_a_mistake():
    with pytest.raises(ZeroDivisionError):
        network.concurrently(lambda item: 1 / item, [1, 0], 1, str)


def test_awaited_ends_as_soon_as_it_may_and_at_the_deadline():
    seen = iter([1, 2, 3])
    assert network.awaited(lambda: next(seen), lambda value: value == 2, time.monotonic() + 10) == 2
    assert network.awaited(lambda: "no", lambda value: False, time.monotonic()) == "no"


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
    found = network.discovery(master(discovery), 0)
    assert found["open"] and not found["error"]
    assert abs(found["clock_offset_s"] - 3600) <= found["clock_uncertainty_s"] + 1e-3


def test_discovery_that_refuses_or_is_something_else():
    with socket.socket() as closed:
        closed.bind(("127.0.0.1", 0))
        found = network.discovery(master(closed.getsockname()[1]), 0)
        assert not found["open"] and "refused" in found["error"]
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        thread = threading.Thread(target=lambda: [_greet(other) for turn in range(2)], daemon=True)
        thread.start()
        found = network.discovery(master(other.getsockname()[1]), 0)
        assert found["open"] and found["clock_offset_s"] is None and "getCurrentTime failed" in found["clock_error"]


def _greet(listener):
    connection = listener.accept()[0]
    connection.sendall(b"SSH-2.0-OpenSSH\r\n")
    connection.close()


def test_discovery_that_comes_late_is_awaited():
    with socket.socket() as late:
        late.bind(("127.0.0.1", 0))
        port = late.getsockname()[1]
        threading.Timer(0.7, late.listen).start()
        assert network.discovery(master(port), time.monotonic() + 0)["open"] is False
        found = {}
        began = time.monotonic()
        found.update(
            network.awaited(lambda: network._connect("127.0.0.1", port), lambda seen: seen["open"], began + 10)
        )
        assert found["open"] and time.monotonic() - began < 5


@pytest.fixture
def ros(tmp_path):
    """An environment whose ROS commands are small scripts."""
    tmp_path.chmod(0o755)
    for folder in tmp_path.parents:
        if folder.stat().st_uid == os.geteuid() and folder != folder.parent:
            folder.chmod(folder.stat().st_mode | 0o011)
    (tmp_path / "environment").write_text(f"ROS_MASTER_URI=http://127.0.0.1:1\nPATH={tmp_path}:/usr/bin:/bin\n")

    def command(name, script):
        path = tmp_path / name
        path.write_text("#!/bin/sh\n" + script)
        path.chmod(0o755)

    with probe_ros.Ros(str(tmp_path / "environment")) as made:
        yield made, command


def test_command_runs_in_the_environment_of_the_file(ros):
    made, command = ros
    command("rosservice", 'echo "$ROS_MASTER_URI $ROS_HOME $*"; test -w "$ROS_HOME"')
    output, error = made.run("rosservice", ["call", "/x"], 5)
    assert output.split() == ["http://127.0.0.1:1", made.folder, "call", "/x"] and not error


def test_command_that_never_ends_is_interrupted(ros, monkeypatch):
    monkeypatch.setattr(probe_ros, "SHORTEST", 0)
    made, command = ros
    command("rostopic", 'trap "echo unregistered; exit 0" INT; while :; do sleep 0.1; done')
    output, error = made.run("rostopic", ["echo", "/x"], 0.5)
    assert output == "unregistered\n" and "printed nothing within" in error


def test_command_that_fails_or_is_not_there(ros):
    made, command = ros
    command("rostopic", "echo first >&2; echo 'ERROR: Unable to communicate with master!' >&2; exit 1")
    assert made.run("rostopic", [], 5)[1] == "ERROR: Unable to communicate with master!"
    with pytest.raises(probe_ros.NoRos, match="no command roscall"):
        made.run("roscall", [], 5)


def test_without_an_environment_there_is_a_sentence(tmp_path):
    with probe_ros.Ros(str(tmp_path / "none")) as made:
        assert "no ROS_MASTER_URI" in probe_ros.roscore(made, 0)["error"]
        assert "site.yml" in probe_ros.list_masters(made, set(), 0)["error"]
        assert probe_ros.topics(made, ["kobuki2computer"], "run", "kobuki1computer", 0) == []
        assert "site.yml" in made.missing()


class Master:
    """A roscore as far as the probe asks it."""

    def getUri(self, caller):
        return 1, "", "http://127.0.0.1:11311/"

    def getSystemState(self, caller):
        return 1, "", [[["/multimaster_verify/kobuki2computer", ["/rostopic_1_1"]]], [], []]

    def lookupNode(self, caller, node):
        return (1, "", "http://kobuki2computer:41233/") if node == "/rostopic_1_1" else (-1, "unknown node", "")


@pytest.fixture
def roscore(ros):
    made, command = ros
    server = xmlrpc.server.SimpleXMLRPCServer(("127.0.0.1", 0), logRequests=False)
    server.register_instance(Master())
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    made.uri = f"http://127.0.0.1:{server.server_address[1]}"
    yield made, command
    server.shutdown()
    thread.join()
    server.server_close()


# Stands for the Python of ROS: what it is given is the listener and its arguments, and it says what it heard.
LISTENER = """#!/usr/bin/env python3
import json, sys
assert "rospy" in open(sys.argv[1]).read()
wanted = json.loads(sys.argv[4])
print(json.dumps({topic: {"text": TEXT, "node": "/n", "seconds": 0.2} for topic, text in wanted.items() if "2" in topic}))
"""


def pretend(made, text):
    """A rostopic whose interpreter is LISTENER; returns after it is in place."""
    folder = os.path.dirname(made.file)
    for name, script in (("python", LISTENER.replace("TEXT", text)), ("rostopic", f"#!{folder}/python\n")):
        path = os.path.join(folder, name)
        pathlib.Path(path).write_text(script)
        os.chmod(path, 0o755)


def test_one_node_listens_to_all_talkers(roscore):
    made, _command = roscore
    pretend(made, "text")
    talkers = ["kobuki2computer", "kobuki3computer"]
    heard, silent = probe_ros.topics(made, talkers, "run", "kobuki1computer", 0)
    assert (heard["heard"], heard["text"], heard["seconds"], heard["error"]) == (True, "run kobuki2computer", 0.2, "")
    assert heard["publishers"] == [{"node": "/rostopic_1_1", "uri": "http://kobuki2computer:41233/"}]
    assert not silent["heard"] and silent["publishers"] == [] and "not registered" in silent["error"]


def test_an_older_talker_is_not_taken_for_this_run(roscore):
    made, _command = roscore
    pretend(made, "'yesterday kobuki2computer'")
    entry = probe_ros.topics(made, ["kobuki2computer"], "run", "kobuki1computer", 0)[0]
    assert not entry["heard"] and "yesterday" in entry["error"]


def test_a_listener_that_fails_says_why(roscore):
    made, _command = roscore
    pretend(made, "unknown_name")
    entry = probe_ros.topics(made, ["kobuki2computer"], "run", "kobuki1computer", 0)[0]
    assert not entry["heard"] and "unknown_name" in entry["error"]


def test_the_listener_waits_for_what_this_run_says(monkeypatch, capsys):
    """The program itself, with a rospy that delivers at once: first what an older talker says, then this run's."""
    subscribed = []

    class Message:
        def __init__(self, data):
            self.data, self._connection_header = data, {"callerid": "/talker"}

    def subscriber(topic, kind, hear, argument):
        subscribed.append(topic)
        hear(Message("old"), argument)
        if topic == "/a":
            threading.Timer(0.2, hear, (Message("run a"), argument)).start()

    rospy = types.SimpleNamespace(
        init_node=lambda *arguments, **options: None,
        Subscriber=subscriber,
        is_shutdown=lambda: False,
        signal_shutdown=lambda reason: None,
    )
    message = types.SimpleNamespace(String=object)
    for name, module in (("rospy", rospy), ("std_msgs", types.SimpleNamespace(msg=message)), ("std_msgs.msg", message)):
        monkeypatch.setitem(sys.modules, name, module)
    monkeypatch.setattr(probe_listener.os, "_exit", lambda status: None)
    began = time.monotonic()
    probe_listener.main("listener", time.time() + 60, {"/a": "run a"})
    assert time.monotonic() - began < 50
    probe_listener.main("listener", time.time() + 0.3, {"/b": "run b"})
    first, second = map(json.loads, capsys.readouterr().out.splitlines())
    assert subscribed == ["/a", "/b"]
    assert (first["/a"]["text"], first["/a"]["node"], second["/b"]["text"]) == ("run a", "/talker", "old")


def test_forwarding_is_what_is_effective(tmp_path):
    found = network.forwarding()
    assert found["ip_forward"] in (0, 1) and all(entry["addresses"] for entry in found["interfaces"])
    (tmp_path / "ip_forward").write_text("1\n")
    for place in ["all", *[entry["interface"] for entry in found["interfaces"]]]:
        folder = tmp_path / "conf" / place
        folder.mkdir(parents=True)
        for setting, value in (
            ("forwarding", "1"),
            ("rp_filter", "2" if place == "all" else "1"),
            ("send_redirects", "0"),
        ):
            (folder / setting).write_text(value + "\n")
    for entry in network.forwarding(str(tmp_path))["interfaces"]:
        assert (entry["forwarding"], entry["rp_filter"], entry["send_redirects"]) == (1, 2, 0)


def test_calls_arrive_empty():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as helper:
        helper.bind(("127.0.0.1", 0))
        helper.settimeout(2)
        assert network.call(["127.0.0.1"], helper.getsockname()[1]) == ""
        assert [helper.recv(10) for number in range(network.TRIES)] == [b""] * network.TRIES
    assert network.call(["255.255.255.255"], 9)  # refused by the kernel: not allowed without asking for it


def test_master_api(roscore):
    made, _command = roscore
    assert probe_ros.roscore(made, 0)["answer"] == "http://127.0.0.1:11311/"
    with pytest.raises(OSError, match="unknown node"):
        made.ask("lookupNode", "/nobody")
