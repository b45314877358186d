# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Streams to talkers that are the programs that they are, found at a roscore."""

from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.measure import streams
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.measure.talker import (
    node_of,
    sentence_of,
    topic_of,
)
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.ros_client.ros import Ros
from talking import Roscore, served, talking, until

NAMES = "robot2computer", "robot3computer"


def asking(tmp_path, uri):
    path = tmp_path / "environment"
    path.write_text(f'ROS_MASTER_URI="{uri}"\n')
    return Ros(str(path), {})


def test_each_talker_gets_a_stream_and_a_missing_one_a_sentence(tmp_path):
    roscore = Roscore()
    with served(roscore) as uri:
        name = NAMES[0]
        with talking(uri, node_of("run", name), topic_of(name), sentence_of("run", name)):
            until(lambda: roscore.of(topic_of(name)))
            found = streams.streams(asking(tmp_path, uri), list(NAMES), "run", "robot1computer", 0.1)
    assert [row["computer"] for row in found] == list(NAMES)
    assert found[0]["mbit_s"] > 1 and found[0]["error"] == ""
    assert found[1]["mbit_s"] is None and "unknown node" in found[1]["error"]


def test_a_talker_that_has_ended_says_why(tmp_path):
    roscore = Roscore()
    roscore.publishers[topic_of(NAMES[0])] = {node_of("run", NAMES[0]): "http://127.0.0.1:9/"}
    with served(roscore) as uri:
        (row,) = streams.streams(asking(tmp_path, uri), list(NAMES[:1]), "run", "robot1computer", 0.1)
    assert row["error"] == "Connection refused"


def test_all_together_have_a_time(tmp_path, monkeypatch):
    monkeypatch.setattr(streams, "SPARE", -10.0)
    found = streams.streams(asking(tmp_path, "http://127.0.0.1:1"), list(NAMES), "run", "robot1computer", 0.1)
    assert [row["error"] for row in found] == ["others took too long"] * 2
