# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The clock and the disks of this machine."""

import os
import subprocess
import sys

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._process import processes
from ansible_collections.rosfleet.multimaster.plugins.module_utils._verify import resources

root = pytest.mark.skipif(os.geteuid() != 0, reason="mounts need root")


def test_the_kernel_tells_if_the_clock_is_kept_right():
    assert resources.clock()["synchronised"] in (True, False, None)


def test_each_file_system_is_counted_once(tmp_path):
    (tmp_path / "a").mkdir()
    folders = [str(tmp_path), str(tmp_path / "a"), str(tmp_path / "missing")]
    (found,) = resources.disks([], folders)
    assert found["path"] == str(tmp_path) and found["free_bytes"] > 0


@root
def test_a_full_file_system(tmp_path):
    full = tmp_path / "full"
    full.mkdir()
    subprocess.run(["mount", "-t", "tmpfs", "-o", "size=64k", "none", str(full)], check=True)
    try:
        with open(full / "data", "wb") as file:
            file.write(bytes(64 << 10))
        found = resources.disks([], [str(tmp_path), str(full)])
    finally:
        subprocess.run(["umount", str(full)], check=True)
    assert [entry["path"] for entry in found] == [str(tmp_path), str(full)]
    assert found[1]["free_bytes"] == 0


NODE = """
import resource, socket, sys
resource.setrlimit(resource.RLIMIT_NOFILE, (int(sys.argv[1]), resource.getrlimit(resource.RLIMIT_NOFILE)[1]))
with socket.socket() as listener:
    listener.bind(("127.0.0.1", 0))
    if sys.argv[2] == "listens":
        listener.listen()
    print("ready", flush=True)
    sys.stdin.read()
"""


def _find_limits(limit, listens, variables, *words):
    """Look at this machine while a process has such a limit, and return what is told of it."""
    argv = [PROGRAM, "-c", NODE, str(limit), listens, *words]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    with subprocess.Popen(argv, executable=sys.executable, env=variables, **pipes) as process:
        assert process.stdout.readline() == b"ready\n"
        assert processes.file_limit(process.pid) == limit
        found = [entry["node"] for entry in resources.file_limits() if entry["limit"] == limit]
        process.stdin.close()
    return found


LIMIT = 1873  # no other process has it
PROGRAM = f"node-{os.getpid()}"  # nodes of one name are told once, and other tests have nodes at the same time
ROS = {"ROS_MASTER_URI": "http://here:11311/"}


@pytest.mark.parametrize(
    ("limit", "listens", "variables", "words", "told"),
    [
        (LIMIT, "listens", ROS, (), True),
        (LIMIT, "listens", {}, ("__name:=laser",), True),
        (LIMIT, "listens", {}, (), False),  # no process of ROS
        (LIMIT, "is silent", ROS, (), False),  # a shell
        (LIMIT - 100, "listens", ROS, (), False),
    ],
)
def test_a_node_that_may_open_many_files(monkeypatch, limit, listens, variables, words, told):
    monkeypatch.setattr(resources, "MOST_FILES", LIMIT - 1)
    name = words[0].partition(":=")[2] if words else PROGRAM
    assert _find_limits(limit, listens, variables, *words) == ([name] if told else [])


def test_no_limit_of_a_process_that_has_ended():
    assert processes.file_limit(1 << 30) == 0
