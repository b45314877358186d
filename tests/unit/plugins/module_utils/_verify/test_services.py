# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The services of the collection: the environment of their processes."""

import os
import signal
import subprocess

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._verify import services


def test_differing_names_what_the_process_lacks():
    process = {"ROS_MASTER_URI": "http://old:11311", "PATH": "/bin"}
    wanted = {"ROS_MASTER_URI": "http://new:11311", "ROS_HOSTNAME": "kobuki1computer", "PATH": "/bin"}
    assert services.find_changed(process, wanted) == ["ROS_HOSTNAME", "ROS_MASTER_URI"]


@pytest.mark.parametrize(
    ("files", "differing"), [("/etc/rosfleet-multimaster/environment (ignore_errors=no)", ["NOT_HERE"]), ("", [])]
)
def test_a_service_without_the_environment_file_is_the_same(monkeypatch, files, differing):
    seen = {"ActiveState": "active", "MainPID": str(os.getpid()), "EnvironmentFiles": files}
    monkeypatch.setattr(services.systemd, "states", lambda units, properties: [seen for unit in units])
    assert services.services(["connections"], {"NOT_HERE": "1"})[0]["differing"] == differing


def test_a_drop_in_file_with_other_variables_is_named(monkeypatch, tmp_path):
    for name, text in (("a", "[Service]\n  EnvironmentFile=/run/one\n"), ("b", "[Service]\nNice=5\n")):
        (tmp_path / f"{name}.conf").write_text(text)
    paths = " ".join(str(tmp_path / f"{name}.conf") for name in "abc")
    seen = {"MainPID": str(os.getpid()), "EnvironmentFiles": "one", "DropInPaths": paths}
    monkeypatch.setattr(services.systemd, "states", lambda units, properties: [seen for unit in units])
    assert services.services(["sync"], {"NOT_HERE": "1"})[0]["drop_ins"] == [str(tmp_path / "a.conf")]
    assert services.services(["sync"], {})[0]["drop_ins"] == []


def test_a_process_that_is_stopped_is_seen(monkeypatch):
    process = subprocess.Popen(["sleep", "60"])
    seen = {"ActiveState": "active", "MainPID": str(process.pid)}
    monkeypatch.setattr(services.systemd, "states", lambda units, properties: [seen for unit in units])
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
        ("; refused: " + ", ".join(f"/{number}" for number in range(90)), [f"/{number}" for number in range(50)]),
    ],
)
def test_refusals_are_read_from_the_status(status, names):
    assert services.read_refusals(status) == names
