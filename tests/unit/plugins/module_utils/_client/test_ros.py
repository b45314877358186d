# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The ROS of a computer: commands, the roscore, and the outputs of rosservice."""

import os

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._client import ros as probe_ros
from ansible_collections.rosfleet.multimaster.plugins.module_utils._verify import topics
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan import environment as environment_module
from hypothesis import given
from hypothesis import strategies as st
from provider import LIST_MASTERS, answer, head, master, provider, rows


def test_command_runs_in_the_environment_of_the_file(ros):
    made, command = ros
    command("rosservice", 'echo "$ROS_MASTER_URI $HOME $ROS_HOME $*"; touch "$ROS_HOME/log"')
    output, error = made.run("rosservice", ["call", "/x"], 5)
    uri, home, *rest = output.split()
    assert (uri, rest) == ("http://127.0.0.1:1", [home, "call", "/x"]) and not error
    assert not os.path.exists(home)


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
    with pytest.raises(probe_ros.RosMissing, match="no command roscall"):
        made.run("roscall", [], 5)


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


# As rosservice of ROS 1.15 prints it.
LISTED = """masters:\x20
  -\x20
    name: "kobuki1computer"
    uri: "http://kobuki1computer:11311/"
    last_change:\x20
      secs: 1795230710
      nsecs: 998000144
    last_change_local:\x20
      secs: 1795230709
      nsecs:         0
    online: True
    discoverer_name: "/master_discovery"
    monitoruri: "http://192.168.1.229:11611"
  -\x20
    name: "kobuki2computer"
    uri: "http://kobuki2computer:11311/"
    last_change:\x20
      secs: 0
      nsecs:         0
    last_change_local:\x20
      secs: 0
      nsecs:         0
    online: False
    discoverer_name: "/master_discovery"
    monitoruri: "http://192.168.1.239:11611"
"""


# Fig. 8 of the report: other time fields, texts without quotes.
OLD = """masters:
  -
    name: kobuki1computer
    uri: http://kobuki1computer:11311/
    timestamp: 1426681423.24
    timestamp_local: 1426681423.24
    online: True
    discoverer_name: /master_discovery
    monitoruri: http://192.168.1.229:11611
"""


def test_masters_of_today_and_of_the_report():
    first, second = probe_ros.read_masters(LISTED)
    assert first == {
        "name": "kobuki1computer",
        "uri": "http://kobuki1computer:11311/",
        "online": True,
        "monitoruri": "http://192.168.1.229:11611",
    }
    assert (second["name"], second["online"]) == ("kobuki2computer", False)
    assert probe_ros.read_masters(OLD) == [first]


@pytest.mark.parametrize(
    "text", ["", "masters: []\n", "ERROR: Service [/master_discovery/list_masters] is not available.\n"]
)
def test_no_masters(text):
    assert probe_ros.read_masters(text) == []


@given(st.text(max_size=300))
def test_any_output_is_read(text):
    probe_ros.read_masters(text)
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
        monkeypatch.setattr(type(made), "ask", lambda self, method, name: uri)
        found = probe_ros.list_masters(made, {"one"}, 0)
    assert [(entry["name"], entry["online"]) for entry in found["masters"]] == [("one", True), ("two", False)]
    assert not found["error"]


def test_another_version_of_list_masters_is_asked_by_the_command(roscore, monkeypatch):
    made, command = roscore
    command("rosservice", f"cat <<'END'\n{OLD}END\n")
    with provider(head(md5sum="0", type="multimaster_msgs_fkie/DiscoverMasters")) as uri:
        monkeypatch.setattr(type(made), "ask", lambda self, method, name: uri)
        found = probe_ros.list_masters(made, set(), 0)
    assert [entry["name"] for entry in found["masters"]] == ["kobuki1computer"]


def test_a_discovery_that_is_not_there_is_a_sentence(roscore):
    made, command = roscore
    command("rosservice", "exit 1")
    assert "unknown service" in probe_ros.list_masters(made, {"one"}, 0)["error"]
