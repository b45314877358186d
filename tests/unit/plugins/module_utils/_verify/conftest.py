# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Fixtures for the tests of the probes: an environment with small commands of ROS, and a roscore."""

import os
import pathlib
import sys
import threading
import xmlrpc.server

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._verify.ros import Ros

sys.path.insert(0, str(pathlib.Path(__file__).parent))  # the module `provider`


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

    return Ros(str(tmp_path / "environment")), command


class Master:
    """A roscore as far as the probe asks it."""

    def getUri(self, caller):
        return 1, "", "http://127.0.0.1:11311/"

    def getSystemState(self, caller):
        return 1, "", [[["/multimaster_verify/kobuki2computer", ["/rostopic_1_1"]]], [], []]

    def lookupService(self, caller, service):
        return -1, "unknown service", ""

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
