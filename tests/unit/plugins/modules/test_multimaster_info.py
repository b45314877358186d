# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The answer of multimaster_info about a machine: real commands, sockets and files where there are some."""

import json
import os
import pwd
import re
import socket
import subprocess
import sys
import threading
import time

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._base import commands, deadlines
from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine import ports as ports_module
from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine import shells, system


def assert_gone(command):
    """A killed process is gone a moment later."""
    deadline = time.monotonic() + 20
    while subprocess.run(["pgrep", "-f", command], stdout=subprocess.DEVNULL, check=False).returncode == 0:
        assert time.monotonic() < deadline, command
        time.sleep(0.05)


def test_run_ends_a_slow_command_and_its_children():
    started = time.monotonic()
    sleep = f"sleep 7341{os.getpid()}"  # nobody else's
    answer = commands.run(["sh", "-c", f"{sleep} & {sleep}"], limit=0.3)
    assert answer.status == -1
    assert "gave no answer within 0.3 s" in answer.error
    assert time.monotonic() - started < 20
    assert_gone(sleep)


def test_run_does_not_wait_for_what_stays_in_the_background():
    started = time.monotonic()
    sleep = f"sleep 7342{os.getpid()}"
    assert commands.run(["sh", "-c", f"{sleep} & echo done"]).output == b"done\n"
    assert time.monotonic() - started < 20
    assert_gone(sleep)


def test_run_a_command_that_is_not_there():
    answer = commands.run(["/nowhere/command"])
    assert (answer.status, answer.output) == (-1, b"")
    assert "could not be started" in answer.error


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can become another user")
def test_run_as_nobody_in_a_clean_environment(monkeypatch):
    monkeypatch.setenv("ROS_IP", "10.0.0.9")
    output = commands.run(["sh", "-c", "id -un; id -G; env"], user=commands.find_nobody()).output.decode().splitlines()
    assert output[0] == "nobody"
    assert output[1] == str(pwd.getpwnam("nobody").pw_gid)
    assert not [line for line in output if line.startswith("ROS_")]


def test_within_gives_the_value_the_error_or_a_timeout():
    assert deadlines.call_within(1, int, "7") == 7
    with pytest.raises(ValueError, match="invalid literal"):
        deadlines.call_within(1, int, "x")
    with pytest.raises(TimeoutError, match="no answer within 0.05 s"):
        deadlines.call_within(0.05, time.sleep, 5)


def test_text_never_opens_a_fifo(tmp_path):
    os.mkfifo(tmp_path / "fifo")
    assert commands.text(str(tmp_path / "fifo")) == ""
    assert commands.text(str(tmp_path / "nothing")) == ""


def test_system_reads_os_release(tmp_path):
    (tmp_path / "etc").mkdir()
    (tmp_path / "etc/os-release").write_text(
        'PRETTY_NAME="Ubuntu 20.04.6 LTS"\nID=ubuntu\n# a comment\nVERSION_ID="20.04"\n'
    )
    found = system.system(str(tmp_path))
    assert found["os"] == {"id": "ubuntu", "version": "20.04", "name": "Ubuntu 20.04.6 LTS"}
    assert found["hostname"] == socket.gethostname()
    assert found["systemd"]["running"] is False


@pytest.mark.parametrize(
    ("status", "can"),
    [
        ("CapEff:\t0000000000000000\nCapBnd:\t00000000a82435fb\n", True),
        ("CapBnd:\t00000000a80425fb\n", False),  # podman's and docker's default
        ("CapBnd:\t0000000000001000\n", True),
        ("", True),
    ],
)
def test_whether_systemd_may_give_net_admin(status, can):
    assert system.may_give(status, 12) is can


def test_ports_of_a_real_process():
    script = "#\x1b[1m\nimport socket,sys,time\ns=[socket.socket(f,t) for f,t in ((2,1),(10,1),(2,2))]\n"
    script += "[x.bind(('127.0.0.1' if x.family==2 else '::1',0)) for x in s]\n[x.listen(1) for x in s[:2]]\n"
    script += "print(*[x.getsockname()[1] for x in s],flush=True)\ntime.sleep(30)\n"
    with subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE) as process:
        try:
            ports = [int(port) for port in process.stdout.readline().split()]
            wanted = [{"protocol": p, "port": n} for p, n in zip(("tcp", "tcp", "udp"), ports)]
            found = {(entry["protocol"], entry["port"]): entry for entry in ports_module.holders(wanted)}
        finally:
            process.kill()
    assert [found[key]["address"] for key in zip(("tcp", "tcp", "udp"), ports)] == ["127.0.0.1", "::1", "127.0.0.1"]
    for entry in found.values():
        assert (entry["pid"], entry["user"]) == (process.pid, pwd.getpwuid(os.getuid()).pw_name)
        assert entry["command"].startswith(f"{sys.executable} -c #\\x1b[1m import") and entry["command"].endswith("...")


def test_a_connection_is_no_holder():
    with socket.create_server(("127.0.0.1", 0)) as server, socket.create_connection(server.getsockname()) as client:
        wanted = [{"protocol": "tcp", "port": client.getsockname()[1]}]
        assert ports_module.holders(wanted) == []


@pytest.mark.parametrize(
    ("cgroups", "unit"),
    [
        ("0::/system.slice/multimaster-roscore.service\n", "multimaster-roscore.service"),
        ("12:pids:/system.slice/x.service\n1:name=systemd:/system.slice/foreign.service\n0::/\n", "foreign.service"),
        ("0::/user.slice/user-1000.slice/user@1000.service/app.slice/roscore.service\n", "roscore.service"),
        ("0::/user.slice/user-1000.slice/session-3.scope\n", "session-3.scope"),
        ("0::/\n", ""),
        ("", ""),
    ],
)
def test_unit_of_a_process(cgroups, unit):
    assert ports_module.unit(cgroups) == unit


def test_a_process_in_a_container_has_a_second_number():
    assert ports_module.is_contained("Name:\trosmaster\nNSpid:\t4711\t1\nNSpgid:\t4711\t1\n")
    assert not ports_module.is_contained("Name:\trosmaster\nNSpid:\t4711\nNSpgid:\t4711\n")
    assert not ports_module.is_contained("")


@pytest.mark.parametrize(
    ("line", "found"),
    [
        ("export ROS_MASTER_URI=http://tibi:11311", [("ROS_MASTER_URI", "http://tibi:11311")]),
        ("  ROS_IP='10.0.0.1'  # the wireless one", [("ROS_IP", "10.0.0.1")]),
        ('export A=1 ROS_IP="10.0.0.1" ROS_HOSTNAME=tibi;', [("ROS_IP", "10.0.0.1"), ("ROS_HOSTNAME", "tibi")]),
        ("if true; then export ROS_HOSTNAME=tibi; fi", [("ROS_HOSTNAME", "tibi")]),
        ("[ -f x ]&&export ROS_IP=1.2.3.4||true", [("ROS_IP", "1.2.3.4")]),
        ("declare -x ROS_IP=$(hostname -I | cut -d' ' -f1)", [("ROS_IP", "$")]),
        ("export ROS_IP=`hostname -I`", [("ROS_IP", "`hostname")]),
        ("setenv ROS_IP 10.0.0.1", [("ROS_IP", "10.0.0.1")]),
        ("ROS_IP DEFAULT=10.0.0.1", [("ROS_IP", "10.0.0.1")]),
        ("# export ROS_IP=10.0.0.1", []),
        ("true # export ROS_IP=10.0.0.1", []),
        ("echo 'export ROS_IP=10.0.0.1'", []),
        ("alias away='export ROS_IP=10.0.0.1'", []),
        ("export MY_ROS_IP=10.0.0.1", []),
        ("echo $ROS_IP", []),
        ("unset ROS_IP", []),
    ],
)
def test_assignments_in_a_line(line, found):
    assert [(entry["variable"], entry["value"]) for entry in shells.assignments("\n" + line)] == found
    for entry in shells.assignments("\n" + line):
        assert entry["line"] == 2 and entry["variable"] in entry["text"]
        said = entry["text"].replace("A=...", "A=1")
        assert all(part in " ".join(line.split()) for part in re.split(r" ?[.]{3} ?", said))


@pytest.mark.parametrize(
    ("line", "shown"),
    [
        ("export ROS_MASTER_URI=http://tibi:11311", "export ROS_MASTER_URI=http://tibi:11311"),
        ("export ROS_IP=$(hostname -I | cut -d' ' -f1)", "export ROS_IP=$(hostname -I | cut -d' ' -f1)"),
        ("export API_TOKEN=s3cret ROS_IP=10.0.0.1  # pin s3cret", "export API_TOKEN=... ROS_IP=10.0.0.1"),
        ('TOKEN=s3"cret;"s3cret;export ROS_IP=10.0.0.1', "... export ROS_IP=10.0.0.1"),
        ("export TOKEN='s3cret;s3cret' ROS_IP=10.0.0.1", "export TOKEN=... ROS_IP=10.0.0.1"),
        ("go() { export ROS_IP=10.0.0.1; sshpass -p s3cret ssh tibi; }", "... export ROS_IP=10.0.0.1 ..."),
        ('[ -z "$ROS_IP" ] && export ROS_IP=10.0.0.1', "... export ROS_IP=10.0.0.1"),
    ],
)
def test_reports_show_the_statement_alone_since_its_neighbours_may_have_passwords(line, shown):
    (entry,) = shells.assignments(line)
    assert entry["text"] == shown


def opened(folder):
    """A folder of pytest's that others may enter."""
    for place in [folder, *folder.parents]:
        if place.stat().st_uid == os.geteuid() and place != place.parent:
            place.chmod(place.stat().st_mode | 0o011)
    return folder


@pytest.mark.skipif(os.geteuid() != 0, reason="only root could read what is root's")
def test_a_link_in_a_home_folder_gives_nothing_away(tmp_path):
    home = opened(tmp_path) / "home/robot"
    home.mkdir(parents=True)
    (tmp_path / "etc").mkdir()
    (tmp_path / "etc/passwd").write_text("robot:x:1000:1000::/home/robot:/bin/bash\n")
    (tmp_path / "secret").write_text("ROS_IP=secret\n")
    (tmp_path / "secret").chmod(0o600)
    (home / ".bashrc").symlink_to(tmp_path / "secret")
    os.mkfifo(home / ".profile")
    (home / ".zshrc").write_text("ROS_IP=\x1b[1mred\n" + "x" * 3_000_000 + "\nROS_IP=beyond\n")
    (entry,) = shells.exports(str(tmp_path))["exports"]
    assert (entry["file"], entry["text"]) == ("/home/robot/.zshrc", "ROS_IP=\\x1b[1mred")


def test_a_home_folder_on_a_dead_disk_costs_nobody_else(tmp_path, monkeypatch):
    (tmp_path / "etc").mkdir()
    persons = [f"p{uid}:x:{uid}:{uid}::/home/p{uid}:/bin/bash\n" for uid in range(1000, 1004)]
    (tmp_path / "etc/passwd").write_text("".join(persons))
    ended = threading.Event()

    def run(_program, given, user):
        if user[0] == 1000:
            ended.wait(60)  # also a killed process waits for such a disk
        return commands.Answer(0, json.dumps([[f"{tmp_path}/home/p{user[0]}/.bashrc", ["ROS_IP=1"]]]).encode(), "")

    monkeypatch.setattr(shells, "run", run)
    monkeypatch.setattr(shells, "_READING", 1.0)
    found = [entry["file"] for entry in shells.exports(str(tmp_path))["exports"]]
    ended.set()
    assert found == [f"/home/p{uid}/.bashrc" for uid in (1001, 1002, 1003)]


@pytest.mark.parametrize(
    "said", ["7", "[[{}, []]]", '[["/x"]]', '[["/x", 7]]', "[[7, []]]", '[["/x", [' + "[" * 900 + "]" * 900 + "]]]"]
)
def test_an_answer_that_a_person_made_up_costs_nobody_else(tmp_path, monkeypatch, said):
    (tmp_path / "etc").mkdir()
    (tmp_path / "etc/passwd").write_text("robot:x:1000:1000::/home/robot:/bin/bash\n")
    (tmp_path / "etc/environment").write_text("ROS_IP=2\n")
    monkeypatch.setattr(shells, "run", lambda _program, given, user: commands.Answer(0, said.encode(), ""))
    assert [entry["file"] for entry in shells.exports(str(tmp_path))["exports"]] == ["/etc/environment"]


def test_exports_of_a_machine(tmp_path):
    opened(tmp_path)
    files = {
        "etc/passwd": "root:x:0:0::/root:/bin/bash\nrobot:x:1000:1000::/home/robot:/bin/zsh\n"
        "daemon:x:1:1::/daemon:/bin/bash\nnobody:x:65534:65534::/none:/usr/sbin/nologin\n+::::::\n",
        "etc/bash.bashrc": "export ROS_IP=1\n",
        "etc/environment": "ROS_IP=2\n",
        "etc/profile.d/other.sh": "export ROS_IP=3\n",
        "etc/profile.d/rosfleet-multimaster.sh": "export ROS_IP=ours\n",
        "root/.bashrc": "export ROS_IP=4\n",
        "root/.config/fish/config.fish": "set -q ROS_IP; or set -g -x ROS_IP 8\nset ROS_IP = 9\nset -l ROS_IP 9\n",
        "root/.config/fish/conf.d/a.fish": "set --export ROS_IP '9'\n",
        "home/robot/.zprofile": "export ROS_IP=10\n",
        "home/robot/.zshrc": "\nexport ROS_IP=5\n",
        "etc/environment.d/90-rosfleet-multimaster.conf": "ROS_IP=ours\n",
        "home/robot/.config/environment.d/ros.conf": "ROS_IP=7\n",
        "daemon/.bashrc": "export ROS_IP=6\n",
    }
    for name, content in files.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(content)
    assert [(entry["file"], entry["line"], entry["value"]) for entry in shells.exports(str(tmp_path))["exports"]] == [
        ("/etc/bash.bashrc", 1, "1"),
        ("/etc/profile.d/other.sh", 1, "3"),
        ("/etc/environment", 1, "2"),
        ("/root/.bashrc", 1, "4"),
        ("/root/.config/fish/conf.d/a.fish", 1, "9"),
        ("/root/.config/fish/config.fish", 1, "8"),
        ("/home/robot/.zprofile", 1, "10"),
        ("/home/robot/.zshrc", 2, "5"),
        ("/home/robot/.config/environment.d/ros.conf", 1, "7"),
    ]


@pytest.mark.parametrize(
    ("config", "drop_in", "includes", "others"),
    [
        ("Include /etc/ssh/sshd_config.d/*.conf\nUsePAM yes\n", "", True, []),
        ("#Include /etc/ssh/sshd_config.d/*.conf\n", "", False, []),
        ("Match User x\nInclude sshd_config.d/*.conf\n", "", False, []),
        ("include sshd_config.d/*.conf\nSetEnv A=1\n", "", True, [("/etc/ssh/sshd_config", 2, False)]),
        (
            "Include /etc/ssh/sshd_config.d/*.conf\nMatch User x\n SetEnv A=1\n",
            "",
            True,
            [("/etc/ssh/sshd_config", 3, True)],
        ),
        (
            "Include /etc/ssh/sshd_config.d/*.conf\nsetenv=B=1\n",
            "Match User x\n  SetEnv A=1 # why\n",
            True,
            [("/etc/ssh/sshd_config.d/50-other.conf", 2, True), ("/etc/ssh/sshd_config", 2, False)],
        ),
    ],
)
def test_sshd_files(tmp_path, config, drop_in, includes, others):
    folder = tmp_path / "etc/ssh/sshd_config.d"
    folder.mkdir(parents=True)
    (tmp_path / "etc/ssh/sshd_config").write_text(config)
    (folder / "50-other.conf").write_text(drop_in)
    (folder / "rosfleet-multimaster.conf").write_text("SetEnv ROS_IP=1\n")
    found = shells.sshd(str(tmp_path))
    assert found["includes_drop_ins"] is includes
    assert [(other["file"], other["line"], other["match"]) for other in found["other_setenv"]] == others


def test_sshd_path_and_absence(tmp_path):
    (tmp_path / "etc").mkdir()
    (tmp_path / "etc/environment").write_text('LANG=C\nPATH="/usr/bin:/snap/bin"\n')
    found = shells.sshd(str(tmp_path))
    assert (found["installed"], found["includes_drop_ins"], found["path"]) == (False, False, "/usr/bin:/snap/bin")


def test_sshd_loop_of_includes_ends(tmp_path):
    folder = tmp_path / "etc/ssh"
    folder.mkdir(parents=True)
    (folder / "sshd_config").write_text("Include /etc/ssh/sshd_config\nSetEnv A=1\n")
    assert shells.sshd(str(tmp_path))["other_setenv"]


def test_a_login_shell_is_really_started():
    seen = shells.probe()["login"]
    assert seen["PATH"]
    assert not {"HOME", "PWD", "_"} & set(seen)


def test_unquoted_generator_output():
    assert shells.read_generated('A=plain\nB="a \\"q\\" \\$x \\\\"\n') == {"A": "plain", "B": 'a "q" $x \\'}
