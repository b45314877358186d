# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Fixtures for several rooms: runs that are killed, an environment with small commands of ROS, and a roscore."""

import os
import pathlib
import shutil
import tempfile
import threading
import xmlrpc.server

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.ros_client.ros import Ros
from killed import die_at_call

#: the calls that change files, or open one
CALLS = ("open", "write", "rename", "unlink", "mkdir", "rmdir", "symlink", "chmod", "fchmod", "fsync")


@pytest.fixture
def killed_at():
    """Call a function in a child that gets SIGKILL instead of its `step`-th call that may change a file.

    Returns False when the function ended before.
    """

    def run(step, function, *arguments):
        child = os.fork()
        if child == 0:
            die_at_call(step, *CALLS)
            try:
                function(*arguments)
            finally:
                os._exit(0)
        return os.WIFSIGNALED(os.waitpid(child, 0)[1])

    return run


@pytest.fixture
def synced(monkeypatch):
    """The files and folders that fsync(2) has written, in their order."""
    paths, real = [], os.fsync

    def fsync(descriptor):
        real(descriptor)
        paths.append(os.readlink(f"/proc/self/fd/{descriptor}"))

    monkeypatch.setattr(os, "fsync", fsync)
    return paths


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


@pytest.fixture
def tree():
    """A folder that root alone can change: below /tmp, which has the sticky bit."""
    folder = pathlib.Path(tempfile.mkdtemp())
    folder.chmod(0o755)
    (folder / "ws/devel").mkdir(parents=True)
    (folder / "ws/devel/setup.sh").write_text("export ROS_DISTRO=noetic\n")
    yield folder
    shutil.rmtree(folder)
