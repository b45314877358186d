# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The ROS side, imported beside modules of ROS that do nothing."""

import pathlib
import subprocess
import sys

NODES = pathlib.Path(__file__).parents[4] / "roles/nodes/files/python"
SCRIPT = """
import os, sys
from unittest.mock import MagicMock
for name in "genpy rosgraph rosgraph.network roslib roslib.message rospy std_srvs std_srvs.srv".split():
    sys.modules[name] = MagicMock()
for name in "diagnostic_msgs diagnostic_msgs.msg fkie_multimaster_msgs".split():
    sys.modules[name] = MagicMock()
from rosfleet_multimaster.edge import ros
print(os.environ["ROS_PYTHON_LOG_CONFIG_FILE"])
"""


def test_the_configuration_of_rospys_log_is_there():
    found = subprocess.run(
        [sys.executable, "-c", SCRIPT], cwd=NODES, stdout=subprocess.PIPE, check=True, encoding="utf-8"
    ).stdout
    assert pathlib.Path(found.strip()) == NODES / "rosfleet_multimaster/logging.conf"
    assert pathlib.Path(found.strip()).exists()


ANSWER = """
import time
from types import SimpleNamespace as Message
from rosfleet_multimaster.protocol.messages import Registration
ros.msg.SyncMasterInfo = lambda masteruri: Message(masteruri=masteruri, nodes=[], publisher=[], subscriber=[], services=[])
ros.msg.SyncTopicInfo = ros.msg.SyncServiceInfo = lambda *fields: fields
ros.srv.GetSyncInfoResponse = lambda hosts: hosts
held = {Registration("publisher", "/topic", f"/n{at % 20000}", "http://far:1/", f"{at}"): "http://far:11311/" for at in range(40000)}
began = time.monotonic()
(host,) = ros._sync_info(held)
print(len(host.nodes) == len(set(host.nodes)) == 20000, len(host.publisher) == 40000, time.monotonic() - began < 4.0)
"""


def test_20000_nodes_are_told_in_a_moment():
    """Anybody may call the service: each node was looked for among all."""
    words = [sys.executable, "-c", SCRIPT + ANSWER]
    found = subprocess.run(words, cwd=NODES, stdout=subprocess.PIPE, check=True, encoding="utf-8").stdout
    assert found.split("\n")[1] == "True True True"
