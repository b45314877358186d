# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The hosts that nodes announce: in URIs, and by the environment of real processes."""

import os
import subprocess
import sys

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.ros_client import node_hosts

MEMBERS = [
    {"name": "here-pc", "robot": "one", "address": "192.168.11.2", "discovery_address": "192.168.1.2"},
    {"name": "arm-pc", "robot": "one", "address": "192.168.11.3", "discovery_address": ""},
    {"name": "there-pc", "robot": "two", "address": "192.168.1.3", "discovery_address": "192.168.1.3"},
]
ROS = {"ROS_MASTER_URI": "http://here-pc:11311/"}
PROGRAM = """
import socket, sys
server = socket.create_server(("127.0.0.1", 0))
print(server.getsockname()[1], flush=True)
sys.stdin.read()
"""


def test_planned_hosts_of_the_robot_are_left_out():
    nodes = {
        "/a": "http://here-pc:1024/",
        "/b": "http://192.168.1.2:1024/",
        "/c": "http://ARM-PC:1024/",
        "/d": "http://127.0.0.1:41233/",
        "/e": "http://there-pc:1/",
        "/f": "http://[::1]:77/",
        "/g": "nonsense",
        "/h": "http://far:" + "9" * 5000,
    }
    found = {(row["node"], row["host"], row["port"]) for row in node_hosts.announced(nodes, MEMBERS, "here-pc")}
    assert found == {("/d", "127.0.0.1", 41233), ("/e", "there-pc", 1), ("/f", "::1", 77), ("/h", "far", 0)}


def test_the_answer_is_bounded():
    nodes = {f"/node{number}": "http://127.0.0.1:1/" for number in range(5000)}
    assert len(node_hosts.announced(nodes, MEMBERS, "here-pc")) == node_hosts.MOST


def _find(variables, *words):
    """The row of a real process that listens, started with these variables and words."""
    process = subprocess.Popen(
        [sys.executable, "-c", PROGRAM, *words],
        env={"PATH": os.environ["PATH"], **variables},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
    )
    with process:
        port = int(process.stdout.readline())
        found = [row for row in node_hosts.node_hosts(MEMBERS, "here-pc") if port in row["ports"]]
        process.stdin.close()
    return [(row["host"], row["source"]) for row in found]


@pytest.mark.parametrize(
    ("variables", "words", "expected"),
    [
        ({**ROS, "ROS_IP": "127.0.0.1"}, (), [("127.0.0.1", "ROS_IP")]),
        ({**ROS, "ROS_HOSTNAME": "LocalHost"}, (), [("localhost", "ROS_HOSTNAME")]),
        ({**ROS, "ROS_IP": "192.168.1.2", "ROS_HOSTNAME": "there-pc"}, (), [("there-pc", "ROS_HOSTNAME")]),
        ({**ROS, "ROS_IP": "192.168.1.2"}, ("__ip:=10.0.0.1",), [("10.0.0.1", "__ip")]),
        ({"ROS_IP": "10.0.0.1"}, ("__name:=odom",), [("10.0.0.1", "ROS_IP")]),
        ({**ROS, "ROS_HOSTNAME": "HERE-pc"}, (), []),
        ({**ROS, "ROS_IP": "192.168.11.2"}, (), []),
        ({**ROS, "ROS_IP": "192.168.11.3"}, (), [("192.168.11.3", "ROS_IP")]),  # of another computer of the robot
        ({"ROS_IP": "127.0.0.1"}, (), []),  # no process of ROS
    ],
)
def test_the_host_that_a_process_announces(variables, words, expected):
    assert _find(variables, *words) == expected


def test_without_a_variable_it_is_the_name_of_the_computer(monkeypatch):
    monkeypatch.setattr(node_hosts.socket, "gethostname", lambda: "here-pc")
    assert _find(ROS) == []
    monkeypatch.setattr(node_hosts.socket, "gethostname", lambda: "ubuntu")
    assert _find(ROS) == [("ubuntu", "hostname")]
