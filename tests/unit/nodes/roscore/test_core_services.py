# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The parts of roscore beside rosmaster: parameters, and the node rosout."""

import os

import pytest
from rosfleet_multimaster.roscore import core_services as module


class Roscore:
    """A parameter server."""

    def __init__(self, **parameters):
        self.parameters, self.set = {f"/{name}": value for name, value in parameters.items()}, []

    def __call__(self, method, _caller, name, *value):
        if method == "setParam":
            self.parameters[name] = value[0]
            self.set.append(name)
        if method == "hasParam":
            return [1, "", name in self.parameters]
        return [1, "", self.parameters[name]] if name in self.parameters else [-1, "not set", 0]


def test_the_run_id_is_new_once_and_then_stays():
    first, second, later = Roscore(), Roscore(), Roscore(run_id="known")
    for roscore in (first, second, later):
        module.set_run_id(roscore)
    assert first.parameters["/run_id"] != second.parameters["/run_id"] and len(first.parameters["/run_id"]) == 36
    assert later.parameters == {"/run_id": "known"} and later.set == []


@pytest.mark.parametrize(
    ("uri", "name"),
    [
        ("http://kobuki1computer:11311/", "host_kobuki1computer__11311"),
        ("http://My-PC.local:11411/", "host_my_pc_local__11411"),
        ("http://192.168.1.5:11311/", "host_192_168_1_5__11311"),
    ],
)
def test_roslaunch_finds_the_program_by_its_parameter(uri, name):
    roscore = Roscore()
    module.set_uri(roscore, uri)
    assert roscore.parameters == {f"/roslaunch/uris/{name}": uri}


def test_versions_are_set_where_they_are_known_and_not_again(monkeypatch):
    answers = {("rosversion", "roslaunch"): "1.15.15\n", ("rosversion", "-d"): "noetic\n"}
    monkeypatch.setattr(module, "output", lambda command, _seconds: answers[tuple(command)])
    roscore = Roscore(rosversion="1.15.15\n")
    module.set_versions(roscore)
    assert roscore.parameters == {"/rosversion": "1.15.15\n", "/rosdistro": "noetic\n"} and roscore.set == [
        "/rosdistro"
    ]
    answers.update(dict.fromkeys(answers, ""))
    module.set_versions(roscore)
    assert roscore.set == ["/rosdistro"], "nobody could tell"


class Child:
    """A program that is started, and ends when the test says so."""

    def __init__(self, told):
        self.starts, self.there, self.missing, self.told = 0, False, "", told

    def runs(self):
        return self.there

    def start(self, _command):
        self.starts += 1
        if self.missing:
            raise FileNotFoundError(self.missing)
        self.there = True

    def end(self, _seconds):
        self.there = False


@pytest.fixture
def rosout(monkeypatch):
    monkeypatch.setattr(module, "Child", Child)
    found = module.Rosout(lambda _name: found.held)
    found.held = ""
    return found


def test_rosout_is_started_and_started_again_each_time_later(rosout):
    now, starts = 1000.0, []
    for _second in range(400):
        before = rosout._child.starts
        rosout.tick(now)
        if rosout._child.starts > before:
            starts.append(now)
            rosout._child.there = False  # it ends at once
        now += 0.5
    pauses = [late - early for early, late in zip(starts, starts[1:])]
    assert pauses[:6] == [1, 2, 4, 8, 16, 30] and set(pauses[6:]) == {30}


def test_rosout_that_has_run_for_a_while_is_started_again_soon(rosout):
    for now in (0.0, 1.0, 2.0, 500.0):
        rosout.tick(now)
    rosout._child.there = False
    rosout.tick(501.0)
    assert rosout._child.starts == 2 and rosout._child.runs()


def test_rosout_of_somebody_else_is_left_alone(rosout):
    rosout.held = "http://robot:1/"
    for now in range(100):
        rosout.tick(float(now))
    assert rosout._child.starts == 0


def test_where_there_is_no_rosout_one_warning_says_so(rosout, caplog):
    rosout._child.missing = "rosrun"
    for now in range(300):
        rosout.tick(float(now))
    assert rosout._child.starts > 5
    assert [record.message for record in caplog.records] == ["rosout cannot be started: rosrun"]


def test_tools_see_the_processes_of_a_roscore(rosout):
    methods = module.roslaunch_methods(rosout)
    assert methods["list_processes"]() == [1, "processes on parent machine", [[], [["rosout-1", 0]]]]
    rosout.tick(0.0)
    assert methods["list_processes"]() == [1, "processes on parent machine", [[["rosout-1", 0]], []]]
    assert methods["get_pid"]() == [1, "", os.getpid()] and methods["get_node_names"]()[2] == ["/rosout"]
    rosout.end()
    assert not rosout._child.runs()


def test_a_rosout_message_is_one_record_whatever_is_in_it(rosout, caplog):
    with caplog.at_level("INFO", "rosfleet.roscore"):
        rosout._child.told("<0>shut down\r\x1b[2J")
    (record,) = caplog.records
    assert (record.levelname, record.getMessage()) == ("INFO", "rosout says: <0>shut down\r\x1b[2J")
