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
