# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The processes of people's nodes: real ones, and files as a container shows them."""

import os
import signal
import subprocess
import sys
import time

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._base.commands import Answer
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.people import node_processes
from namespaces import why_not

MEMBERS = [
    {"name": "here-pc", "robot": "one", "address": "192.168.11.2", "discovery_address": "192.168.1.2"},
    {"name": "arm-pc", "robot": "one", "address": "192.168.11.3", "discovery_address": ""},
    {"name": "there-pc", "robot": "two", "address": "192.168.1.3", "discovery_address": "192.168.1.3"},
]
ROS = {"ROS_MASTER_URI": "http://here-pc:11311/"}
HERE = {**ROS, "ROS_HOSTNAME": "here-pc"}
PROGRAM = """
import socket, sys
server = socket.create_server(("127.0.0.1", 0))
print(server.getsockname()[1], flush=True)
sys.stdin.read()
"""


def _is_it(row, port):
    """A container of somebody else on this machine may listen on the same port of its own network."""
    return port in row["ports"] and row["starter"] != "container"


def _find(variables, *words, master="http://here-pc:11311/", within=()):
    """The row of a real process that listens, started with these variables and words, within another command."""
    process = subprocess.Popen(
        [*within, sys.executable, "-c", PROGRAM, *words],
        env={"PATH": os.environ["PATH"], **variables},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
    )
    with process:
        port = int(process.stdout.readline())
        found = [row for row in node_processes.node_hosts(MEMBERS, "here-pc", master) if _is_it(row, port)]
        process.stdin.close()
    return found


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
    assert [(row["host"], row["source"]) for row in _find(variables, *words)] == expected


def test_without_a_variable_it_is_the_name_of_the_computer(monkeypatch):
    monkeypatch.setattr(node_processes.socket, "gethostname", lambda: "here-pc")
    assert _find(ROS) == []
    monkeypatch.setattr(node_processes.socket, "gethostname", lambda: "ubuntu")
    (row,) = _find(ROS)
    assert (row["host"], row["source"], row["starter"]) == ("ubuntu", "hostname", "shell")


@pytest.mark.parametrize(
    ("variables", "words", "shown", "expected"),
    [
        ({"ROS_IP": "127.0.0.1"}, (), "Environment=ROS_IP=127.0.0.1", True),
        ({"ROS_IP": "127.0.0.1"}, (), 'Environment=PATH=/bin "NOTE=a b" ROS_IP=127.0.0.1', True),
        ({"ROS_IP": "127.0.0.1"}, (), "Environment=OLD_ROS_IP=127.0.0.1 ROS_IP_OLD=1", False),
        (
            {"ROS_IP": "127.0.0.1"},
            (),
            "Environment=",
            False,
        ),  # a script of it does, or the unit is of a person's manager
        ({"ROS_IP": "127.0.0.1"}, (), "Environment=\nEnvironmentFiles={file} (ignore_errors=yes)", True),
        ({"ROS_HOSTNAME": "odd"}, (), "Environment=\nEnvironmentFiles={file} (ignore_errors=no)", False),
        ({"ROS_IP": "127.0.0.1"}, ("__ip:=10.0.0.1",), "Environment=ROS_IP=127.0.0.1", False),
        ({"ROS_IP": "127.0.0.1", "ROS_MASTER_URI": "http://odd:1"}, (), "Environment=ROS_IP=127.0.0.1", False),
        # its script exports another one
        ({"ROS_IP": "127.0.0.1"}, (), "Environment=ROS_IP=192.168.1.2", False),
        ({"ROS_IP": "127.0.0.1"}, (), "Environment=ROS_IP=127.0.0.11", False),
        ({"ROS_IP": "127.0.0.1"}, (), "Environment='ROS_IP=127.0.0.1'", True),
        ({}, (), "Environment=", True),  # it announces another name than the plan's, as no variable is there
    ],
)
def test_who_gives_the_variables_of_a_unit_is_told(tmp_path, monkeypatch, variables, words, shown, expected):
    (tmp_path / "robot").write_text("# ROS\nROS_IP=127.0.0.1\n")
    asked = []

    def show(argv, limit):
        assert 0 < limit <= node_processes.stretch(node_processes.UNITS)
        asked.append(argv[-1])
        return Answer(0, shown.format(file=tmp_path / "robot").encode(), "")

    monkeypatch.setattr(node_processes, "run", show)
    monkeypatch.setattr(node_processes.ports, "unit", lambda _groups: "odom.service")
    (row,) = _find({**ROS, **variables}, *words)
    assert (row["starter"], row["of_unit"], set(asked) <= {"odom.service"}) == ("unit", expected, True)


@pytest.mark.parametrize(("variables", "of_unit"), [({"ROS_IP": "127.0.0.1"}, False), ({}, True)])
def test_the_variables_of_a_persons_unit_are_not_those_of_a_unit_of_the_computer(monkeypatch, variables, of_unit):
    monkeypatch.setattr(node_processes.ports, "unit", lambda _groups: "odom.service")
    monkeypatch.setattr(node_processes.ports, "person", lambda _groups: "ann")
    shown = Answer(0, b"Environment=ROS_IP=127.0.0.1", "")
    monkeypatch.setattr(node_processes, "run", lambda argv, limit: shown)
    (row,) = _find({**ROS, **variables})
    assert (row["starter"], row["unit"], row["person"], row["of_unit"]) == ("unit", "odom.service", "ann", of_unit)


def test_a_unit_is_asked_once_and_all_of_them_have_one_limit(monkeypatch):
    asked = []
    monkeypatch.setattr(node_processes, "run", lambda argv, limit: asked.append(argv[-1]) or Answer(-1, b"", "late"))
    units = node_processes.Units()
    assert [units.read(name) for name in ("a.service", "b.service", "a.service")] == ["", "", ""]
    units._deadline = time.monotonic()
    assert units.read("c.service") == "" and asked == ["a.service", "b.service"]


@pytest.mark.skipif(bool(why_not()), reason=why_not())
def test_a_process_in_a_network_of_its_own_is_told():
    (row,) = _find(HERE, within=("unshare", "--net", "sh", "-c", 'ip link set lo up && exec "$@"', "sh"))
    assert (row["host"], row["apart"]) == ("here-pc", True)
    (row,) = _find({**ROS, "ROS_IP": "127.0.0.1"})
    assert not row["apart"]


@pytest.mark.parametrize(
    ("uri", "planned", "expected"),
    [
        ("http://here-pc:11311", "http://here-pc:11311/", None),
        ("http://192.168.11.2:11311/", "http://here-pc:11311/", None),
        ("http://localhost:11311/", "http://here-pc:11311/", None),  # the roscore is on this computer
        ("http://localhost:11311/", "http://arm-pc:11311/", "http://localhost:11311/"),
        ("http://there-pc:11311/", "http://here-pc:11311/", "http://there-pc:11311/"),
        ("http://here-pc:11411/", "http://here-pc:11311/", "http://here-pc:11411/"),
        ("http://user:secret@there-pc/", "http://here-pc:11311/", "http://there-pc:11311/"),
        ("nonsense", "http://here-pc:11311/", None),
        ("http://there-pc:11311/", "", None),
    ],
)
def test_a_process_with_another_roscore_is_told(uri, planned, expected):
    found = _find({"ROS_HOSTNAME": "here-pc", "ROS_MASTER_URI": uri}, master=planned)
    told = [(row["master"], row["master_source"]) for row in found]
    assert told == ([] if expected is None else [(expected, "ROS_MASTER_URI")])


def test_an_argument_that_decides_the_roscore_is_told():
    (row,) = _find({**ROS, "ROS_HOSTNAME": "here-pc"}, "__master:=http://there-pc:11311/")
    assert (row["master"], row["master_source"], row["source"]) == (
        "http://there-pc:11311/",
        "__master",
        "ROS_HOSTNAME",
    )
    (row,) = _find({**ROS, "ROS_IP": "127.0.0.1"})
    assert (row["master"], row["master_source"]) == ("", "")


def test_nothing_else_of_a_process_is_told():
    secret = {"ROS_IP": "127.0.0.1", "PASSWORD": "hidden1", "ROS_PASSWORD": "hidden2"}
    (row,) = _find({**ROS, **secret}, "--token=hidden3", "__name:=odom", "_key:=hidden4")
    assert "hidden" not in repr(row)
    assert (row["node"], row["readable"], row["stopped"]) == ("odom", True, False)


def test_a_stopped_process_is_told():
    process = subprocess.Popen(
        [sys.executable, "-c", PROGRAM],
        env={"PATH": os.environ["PATH"], **HERE},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
    )
    with process:
        port = int(process.stdout.readline())
        process.send_signal(signal.SIGSTOP)
        time.sleep(0.1)
        found = [row for row in node_processes.node_hosts(MEMBERS, "here-pc") if _is_it(row, port)]
        process.send_signal(signal.SIGCONT)
        process.stdin.close()
    assert [(row["host"], row["stopped"]) for row in found] == [("here-pc", True)]


def _pretend(folder, pid, words, parent=1, cgroup="/user.slice/session-4.scope", more=""):
    """A process as /proc has it, without an environment that may be read."""
    place = folder / str(pid)
    place.mkdir(parents=True)
    (place / "cmdline").write_text("\0".join(words) + "\0")
    (place / "stat").write_text(f"{pid} (x) S {parent} " + " ".join(str(number) for number in range(4, 30)))
    (place / "cgroup").write_text(f"0::{cgroup}\n")
    (place / "status").write_text(f"Name:\tx\nNSpid:\t{pid}{more}\n")


@pytest.mark.parametrize(
    ("cgroup", "more", "parent", "expected"),
    [
        ("/user.slice/session-4.scope", "", 1, ("shell", "")),
        ("/user.slice/user-1000.slice/user@1000.service", "", 1, ("shell", "")),
        ("/system.slice/odom.service", "", 1, ("unit", "")),
        ("/system.slice/docker-77aa.scope", "\t5", 1, ("container", "")),
        ("/docker/77aa", "\t5", 1, ("container", "")),
        ("/machine.slice/libpod-77aa.scope", "", 1, ("container", "")),
        ("/user.slice/session-4.scope", "", 70, ("launch", "robot.launch")),
    ],
)
def test_a_node_that_cannot_be_read_is_told_by_its_command_line(tmp_path, monkeypatch, cgroup, more, parent, expected):
    def refuse(pid, proc):
        raise PermissionError

    monkeypatch.setattr(node_processes.processes, "environment", refuse)
    (tmp_path / "net").mkdir()
    launch = ["/usr/bin/python3", "/opt/ros/noetic/bin/roslaunch", "-p", "11311", "/home/ana/secret/robot.launch"]
    _pretend(tmp_path, 70, launch)
    _pretend(tmp_path, 80, ["/opt/odom", "__name:=odom", "--key=hidden"], parent, cgroup, more)
    _pretend(tmp_path, 90, ["/opt/odom", "__name:=ours"], 1, "/system.slice/multimaster-sync.service")
    (row,) = node_processes.node_hosts(MEMBERS, "here-pc", ROS["ROS_MASTER_URI"], str(tmp_path))
    assert (row["starter"], row["launch"]) == expected
    assert (row["node"], row["host"], row["readable"], row["ports"]) == ("odom", "", False, [])
