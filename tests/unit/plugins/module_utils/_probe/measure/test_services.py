# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The services of the collection: the environment of their processes."""

import errno
import os
import signal
import subprocess
import sys
import time

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine.systemd import UnitProperties
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.measure import services


def test_differing_names_what_the_process_lacks():
    process = {"ROS_MASTER_URI": "http://old:11311", "PATH": "/bin"}
    wanted = {"ROS_MASTER_URI": "http://new:11311", "ROS_HOSTNAME": "kobuki1computer", "PATH": "/bin"}
    assert services.find_changed(process, wanted) == ["ROS_HOSTNAME", "ROS_MASTER_URI"]


@pytest.mark.parametrize(
    ("files", "differing"), [("/etc/rosfleet-multimaster/environment (ignore_errors=no)", ["NOT_HERE"]), ("", [])]
)
def test_a_service_without_the_environment_file_is_the_same(monkeypatch, files, differing):
    seen = {"ActiveState": "active", "MainPID": str(os.getpid()), "EnvironmentFiles": files}
    monkeypatch.setattr(services.systemd, "show", lambda units, _properties: UnitProperties([seen for _unit in units]))
    assert services.services(["connections"], {"NOT_HERE": "1"})[0]["differing"] == differing


UNIT = "[Service]\nExecStart=/usr/bin/python3 -m node --parameters %E/node.json\n"
SAME = "/usr/bin/python3 -m node --parameters %E/node.json"


@pytest.mark.parametrize(
    ("text", "variables", "command"),
    [
        ("  EnvironmentFile = -{file}\n", True, False),
        ("EnvironmentFile={folder}/with*\n", True, False),
        ("EnvironmentFile=%h/variables\n", True, False),  # only systemd knows which file it is
        ("EnvironmentFile=\n", True, False),  # no file at all, so not that of the collection
        ("EnvironmentFile={folder}/none\n", False, False),
        ("EnvironmentFile={folder}/other\n", False, False),
        ("Environment=A=1 \\\n  'ROS_IP=10.0.0.1'\n", True, False),
        ("Environment=MY_ROS_IP=10.0.0.1 ROS_IP_2=1\n", False, False),
        ("Environment=\n", False, False),
        ("# Environment=ROS_IP=1\n; Environment=ROS_IP=1\n", False, False),
        ("UnsetEnvironment=LANG ROS_IP\n", True, False),
        ("UnsetEnvironment=ROS_IP_2\n", False, False),
        ("Nice=5\n", False, False),
        ("ExecStart =\nExecStart=/bin/other\n", False, True),
        ("ExecStart=\nExecStart=-/usr/bin/nice -n 5 {same}\n", False, False),
        ("ExecStart=\nExecStart=/usr/bin/taskset 1 \\\n {same}\n", False, False),
        ("ExecStart=\nExecStart={same} _rate:=5\n", False, True),  # other parameters behind the same command
        ("ExecStart=\nExecStart=/usr/bin/env ROS_IP=10.0.0.1 {same}\n", True, False),
        ("ExecStart=\nExecStart=/bin/sh -c 'ROS_IP=10.0.0.1 exec /bin/other'\n", True, True),
        ("ExecStartPre=/bin/sleep 5\nExecStartPost=/bin/true\n", False, False),
        (None, False, False),  # it is not there
    ],
)
def test_a_drop_in_file_is_named_for_the_variables_or_the_command_that_it_sets(
    monkeypatch, tmp_path, text, variables, command
):
    places = {"file": str(tmp_path / "with"), "folder": str(tmp_path), "same": SAME}
    for name, content in (("with", "# one\n ROS_IP=10.0.0.1\n"), ("other", "LANG=C\nA_ROS_IP=1\n"), ("unit", UNIT)):
        (tmp_path / name).write_text(content)
    path = tmp_path / "a.conf"
    if text is not None:
        path.write_text("[Service]\n" + text.format(**places))
    seen = {"MainPID": str(os.getpid()), "EnvironmentFiles": "one", "DropInPaths": str(path)}
    seen["FragmentPath"] = str(tmp_path / "unit")
    monkeypatch.setattr(services.systemd, "show", lambda units, _properties: UnitProperties([seen for _unit in units]))
    monkeypatch.delenv("ROS_IP", raising=False)
    (entry,) = services.services(["sync"], {"ROS_IP": "192.168.1.2"})
    assert (entry["drop_ins"], entry["command_drop_ins"]) == ([str(path)] * variables, [str(path)] * command)
    assert services.services(["sync"], {})[0]["drop_ins"] == []  # no variable differs


def test_empty_lines_and_blanks_of_a_file_of_variables_are_read_in_linear_time(tmp_path):
    (tmp_path / "variables").write_text("\n" * 20000 + "x")
    (tmp_path / "a.conf").write_text(f"EnvironmentFile={tmp_path}/variables\nEnvironment=a{' ' * 20000}x\n")
    began = time.thread_time()
    assert services.list_with_variables([str(tmp_path / "a.conf")], ["ROS_IP"]) == []
    assert time.thread_time() - began < 1


HOLDS = """
import os, resource, sys
resource.setrlimit(resource.RLIMIT_NOFILE, (64, 64))
try:
    while True:
        os.dup(0)
except OSError as problem:
    print(problem.errno, flush=True)
sys.stdin.read()
"""


def test_a_process_without_a_file_left_is_counted(tmp_path):
    """The fullest process of a control group; the others have room."""
    full = subprocess.Popen([sys.executable, "-c", HOLDS], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    try:
        assert int(full.stdout.readline()) == errno.EMFILE
        for folder, pid in (("one", os.getpid()), ("systemd/two", full.pid), ("gone", 1 << 30)):
            group = tmp_path / folder
            group.mkdir(parents=True)
            (group / "cgroup.procs").write_text(f"{os.getpid()}\n{pid}\n" if pid < 1 << 30 else f"{pid}\n")
        assert services.count_files("/two", str(tmp_path)) == (64, 64)
        used, most = services.count_files("/one", str(tmp_path))
        assert 0 < used < most
        assert services.count_files("/gone", str(tmp_path)) == services.count_files("", str(tmp_path)) == (None, None)
    finally:
        full.communicate("")


def test_the_age_of_a_start_is_by_a_clock_that_nobody_steps():
    assert 99.9 < services.find_age(str(int((time.monotonic() - 100) * 1e6))) < 101
    assert services.find_age("0") is services.find_age("") is services.find_age("n/a") is None


def test_a_process_that_is_stopped_is_seen(monkeypatch):
    process = subprocess.Popen(["sleep", "60"])
    seen = {"ActiveState": "active", "MainPID": str(process.pid)}
    monkeypatch.setattr(services.systemd, "show", lambda units, _properties: UnitProperties([seen for _unit in units]))
    try:
        assert not services.services(["sync"], {})[0]["stopped"]
        process.send_signal(signal.SIGSTOP)
        os.waitpid(process.pid, os.WUNTRACED)
        assert services.services(["sync"], {})[0]["stopped"]
    finally:
        process.kill()
        process.wait()
    assert not services.services(["sync"], {})[0]["stopped"]


@pytest.mark.parametrize(
    ("status", "names"),
    [
        ("", []),
        ("no other master", []),
        ("dabo: 3 topics, 1 services; refused: /odom, /base", ["/odom", "/base"]),
        ('dabo: 3 topics, 1 services; refused: "a name, odd", /x; not all of dabo: too many', ['"a name, odd"', "/x"]),
        ("x; refused: /y (offline): 0 topics, 0 services; refused: /z", ["/z"]),
        ("x; refused: /odom, /base, and 9 more; not all of dabo: too many", ["/odom", "/base"]),
        ("; refused: " + ", ".join(f"/{number}" for number in range(90)), [f"/{number}" for number in range(50)]),
    ],
)
def test_refusals_are_read_from_the_status(status, names):
    assert services.read_refusals(status) == (names, [])


def test_the_reasons_of_refusals_are_read_from_the_status():
    told = 'refused: /odom_pub (place http://127.0.0.1:4123/ of "tibi": "it is here, itself"), "a b" (node "" of r2: /x), /cut (place'
    place = {"name": "/odom_pub", "kind": "place", "there": "http://127.0.0.1:4123/", "master": "tibi"}
    node = {"name": "a b", "kind": "node", "there": "", "master": "r2", "here": "/x"}
    names, rows = services.read_refusals(f"r2: 3 topics; {told}")
    assert rows == [{**place, "here": "it is here, itself"}, node]
    assert names[:2] == ["/odom_pub", '"a b"']


def test_no_answer_of_systemd_is_no_state_of_a_service(monkeypatch):
    monkeypatch.setattr(
        services.systemd, "show", lambda units, _properties: UnitProperties([], "no answer within 60 s")
    )
    with pytest.raises(OSError, match="no answer within 60 s"):
        services.services(["sync"], {})
