# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The topics of talkers, heard by one node."""

import os
import pathlib

from ansible_collections.rosfleet.multimaster.plugins.module_utils._verify import topics

# Stands for the Python of ROS: what it is given is the listener and its arguments, and it says what it heard.
LISTENER = """#!/usr/bin/env python3
import json, sys
assert sys.argv[1] == "-c" and "rospy" in sys.argv[2]
wanted = json.load(sys.stdin)
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
    heard, silent = topics.topics(made, talkers, "run", "kobuki1computer", 0)
    assert (heard["heard"], heard["text"], heard["seconds"], heard["error"]) == (True, "run kobuki2computer", 0.2, "")
    assert heard["publishers"] == [{"node": "/rostopic_1_1", "uri": "http://kobuki2computer:41233/"}]
    assert not silent["heard"] and silent["publishers"] == [] and "not registered" in silent["error"]


def test_an_older_talker_is_not_taken_for_this_run(roscore):
    made, _command = roscore
    pretend(made, "'yesterday kobuki2computer'")
    entry = topics.topics(made, ["kobuki2computer"], "run", "kobuki1computer", 0)[0]
    assert not entry["heard"] and "yesterday" in entry["error"]


def test_a_listener_that_fails_says_why(roscore):
    made, _command = roscore
    pretend(made, "unknown_name")
    entry = topics.topics(made, ["kobuki2computer"], "run", "kobuki1computer", 0)[0]
    assert not entry["heard"] and "unknown_name" in entry["error"]
