# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The clock and the disks of this machine."""

import os
import subprocess
import sys

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._base import processes
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.measure import resources

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
    home = {"PYTHONHOME": sys.base_prefix}  # it would be looked for by the name of the program
    with subprocess.Popen(argv, executable=sys.executable, env={**variables, **home}, **pipes) as process:
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


def _fake_process(proc, pid, numbers, variables, hosts):
    """A process as proc(5) shows it, with a root file system of its own."""
    folder = proc / str(pid)
    (folder / "root/etc").mkdir(parents=True)
    (folder / "status").write_text(f"Name:\trosmaster\nNSpid:\t{numbers}\n")
    (folder / "environ").write_text("".join(f"{name}={value}\0" for name, value in variables.items()))
    (folder / "cmdline").write_text("python3\0/usr/bin/rosmaster\0--core\0")
    (folder / "cgroup").write_text(f"0::/system.slice/docker-{pid}.scope\n")
    if hosts is not None:
        (folder / "root/etc/hosts").write_text(hosts)


@pytest.mark.parametrize(
    ("numbers", "variables", "hosts", "missing"),
    [
        ("9\t1", ROS, "127.0.0.1 localhost\n", ["ana-pc", "bob-pc"]),
        ("9\t1", ROS, "192.168.1.1\tANA-PC ana # bob-pc\n", ["bob-pc"]),
        ("9\t1", ROS, "192.168.1.1 ana-pc\n192.168.1.2 bob-pc\n", []),
        ("9\t1", ROS, None, []),
        ("9\t1", {}, "", []),  # no process of ROS
        ("9", ROS, "", []),  # in no container
    ],
)
def test_a_container_that_is_older_than_the_names(tmp_path, numbers, variables, hosts, missing):
    own = tmp_path / "hosts"
    own.write_text("192.168.1.1 ana-pc # rosfleet.multimaster\n192.168.1.2 bob-pc\n")
    _fake_process(tmp_path / "proc", 9, numbers, variables, hosts)
    found = resources.container_names(["ana-pc", "bob-pc", "cid-pc"], str(tmp_path / "proc"), str(own))
    expected = {"node": "rosmaster", "unit": "docker-9.scope", "missing": missing}
    assert found == ([expected] if missing else [])


def test_no_limit_of_a_process_that_has_ended():
    assert processes.file_limit(1 << 30) == 0


@pytest.mark.parametrize(("more", "told"), [(1, False), (0, True)])
def test_a_process_with_all_of_its_files_open_is_named(more, told):
    program = "import os, resource, sys; own = len(os.listdir('/proc/self/fd')) - 1 + 30; "
    program += f"resource.setrlimit(resource.RLIMIT_NOFILE, (own + {2 * more}, 4096)); "
    program += "held = [os.dup(0) for _number in range(30)]; print('ready', flush=True); sys.stdin.read()"
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    with subprocess.Popen([sys.executable, "-c", program, "__name:=bridge"], **pipes) as process:
        assert process.stdout.readline() == b"ready\n"
        found = [entry for entry in resources.full_processes() if entry["pid"] == process.pid]
        process.stdin.close()
    assert [(entry["name"], entry["most_files"] - entry["open_files"]) for entry in found] == [("bridge", 0)] * told
