# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The ROS of a computer: commands, the roscore, and the masters that its discovery lists."""

import os

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.measure import topics
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.ros_client import (
    node_services,
    tcpros,
    xml_rpc,
)
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.ros_client import ros as probe_ros
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan import environment as environment_module
from hypothesis import given
from hypothesis import strategies as st
from provider import LIST_MASTERS, answer, head, master, provider, rows


def test_program_runs_in_the_environment_of_the_file(ros):
    made, command = ros
    command("rostopic", "")
    program = 'read given; echo "$ROS_MASTER_URI $HOME $ROS_HOME $given"; touch "$ROS_HOME/log"'
    output, error = made.run_python(program, 5, "/x\n")
    uri, home, *rest = output.split()
    assert (uri, rest) == ("http://127.0.0.1:1", [home, "/x"]) and not error
    assert not os.path.exists(home)


@pytest.mark.slow
def test_program_that_never_ends_is_ended(ros):
    made, command = ros
    command("rostopic", "")
    with pytest.raises(TimeoutError, match="the Python of ROS printed nothing within 2 s"):
        made.run_python("echo begun; while :; do sleep 0.1; done", 2.0, "")


def test_program_that_fails_or_is_not_there(ros):
    made, command = ros
    with pytest.raises(OSError, match="no command rostopic"):
        made.run_python("", 5, "")
    command("rostopic", "")
    failing = "echo first >&2; echo 'ERROR: Unable to communicate with master!' >&2; exit 1"
    assert made.run_python(failing, 5, "")[1] == "ERROR: Unable to communicate with master!"
    assert made.run_python("exit 3", 5, "")[1] == "the Python of ROS ended with status 3"


def test_without_an_environment_there_is_a_sentence(tmp_path):
    made = probe_ros.Ros(str(tmp_path / "none"))
    assert "no ROS_MASTER_URI" in probe_ros.roscore(made, 0)["error"]
    assert "site.yml" in probe_ros.list_masters(made, set(), 0)["error"]
    assert topics.topics(made, ["kobuki2computer"], "run", "kobuki1computer", 0) == []
    assert "site.yml" in made.problem()


def test_master_api(roscore):
    made, _command = roscore
    assert probe_ros.roscore(made, 0)["answer"] == "http://127.0.0.1:11311/"
    with pytest.raises(OSError, match="unknown node"):
        made.ask("lookupNode", "/nobody")


@given(st.text(max_size=300))
def test_any_output_is_read(text):
    probe_ros.interpreter(text.encode())
    probe_ros.environment(text)


@pytest.mark.parametrize(
    ("script", "words"),
    [
        (b"#!/usr/bin/python3\nimport rostopic\n", ["/usr/bin/python3"]),
        (b"#! /usr/bin/env python\r\n", ["/usr/bin/env", "python"]),
        (b"\x7fELF\x02\x01", []),
        (b"", []),
    ],
)
def test_what_runs_a_command(script, words):
    assert probe_ros.interpreter(script) == words


values = st.text(st.characters(min_codepoint=32, max_codepoint=0x2FF, exclude_characters="\x7f"), max_size=30)


@given(st.dictionaries(st.from_regex(r"[A-Z_][A-Z0-9_]{0,8}", fullmatch=True), values, max_size=5))
def test_environment_is_read_as_it_is_written(variables):
    environment = environment_module.Environment(variables)
    assert probe_ros.environment(environment_module.render_units(environment)) == variables


def test_list_masters_is_asked_without_a_command(roscore, monkeypatch):
    made, command = roscore
    command("rosservice", "exit 1")
    with provider(head(md5sum=LIST_MASTERS), answer(rows(master("one"), master("two", online=False)))) as uri:
        monkeypatch.setattr(tcpros, "ask", lambda master, caller, method, name: uri)
        found = probe_ros.list_masters(made, {"one"}, 0)
    assert [(entry["name"], entry["online"]) for entry in found["masters"]] == [("one", True), ("two", False)]
    assert not found["error"]


def test_a_discovery_node_of_another_name_is_asked(roscore, monkeypatch):
    """As fkie_mas has it, where somebody has started it by hand."""
    made, command = roscore
    command("rosservice", "exit 1")
    name = "/mas_discovery/list_masters"
    state = [[], [], [[name, ["/mas_discovery"]], ["/mas_discovery/refresh", ["/mas_discovery"]]]]
    monkeypatch.setattr(xml_rpc, "ask", lambda uri, caller, method: [*state])
    head_of_mas = head(md5sum=LIST_MASTERS, type="fkie_mas_msgs/DiscoverMasters")
    with provider(head_of_mas, answer(rows(master("one")))) as uri:
        for module in (tcpros, node_services):
            monkeypatch.setattr(module, "ask", lambda master, caller, method, asked: uri if asked == name else "")
        found = probe_ros.list_masters(made, {"one"}, 0)
    assert [entry["name"] for entry in found["masters"]] == ["one"] and not found["error"]


@pytest.mark.slow
@pytest.mark.parametrize("state", [5, [1, 2, 3], [[], [], [["/x"]]]])
def test_a_state_that_is_none_is_a_sentence(roscore, monkeypatch, state):
    made, command = roscore
    command("rosservice", "exit 1")
    monkeypatch.setattr(xml_rpc, "ask", lambda uri, caller, method: state)
    assert probe_ros.list_masters(made, {"one"}, 0)["error"]
    with pytest.raises(OSError, match="no state of a roscore"):
        topics.read_publishers(made)


def test_what_a_strange_roscore_answers_becomes_text(ros, monkeypatch):
    """Else the answer of each computer of the robot would be refused as a whole."""
    made, _command = ros
    monkeypatch.setattr(made, "ask", lambda method, patient: 5)
    assert probe_ros.roscore(made, 0)["answer"] == "5"
    monkeypatch.setattr(xml_rpc, "ask", lambda uri, caller, method: [[[6, [7, None]]], [], []])
    assert topics.read_publishers(made) == {"6": ["7", "None"]}


def test_a_discovery_that_is_not_there_is_a_sentence(roscore):
    made, command = roscore
    command("rosservice", "exit 1")
    assert "unknown service" in probe_ros.list_masters(made, {"one"}, 0)["error"]
