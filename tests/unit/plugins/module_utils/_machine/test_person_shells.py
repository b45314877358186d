# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The shells of persons are asked: real shells, with files as people have them, also with those that hang or print for ever."""

import os
import pathlib
import pwd
import shutil
import time

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._base.commands import Answer
from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine import person_shells, shell_program, shells
from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine.person_shells import Person, Seen

NAMES = shells.VARIABLES
NOBODY = pwd.getpwnam("nobody")
pytestmark = pytest.mark.skipif(os.geteuid() != 0, reason="to become a person takes root")


@pytest.fixture(name="person")
def _person():
    home = pathlib.Path(os.environ.get("SCRATCH", "/tmp")) / f"person-{os.getpid()}-{time.monotonic_ns()}"
    home.mkdir()
    for place in [home, *home.parents]:
        if place.stat().st_uid == 0 and place != place.parent:
            place.chmod(place.stat().st_mode | 0o011)
    os.chown(home, NOBODY.pw_uid, NOBODY.pw_gid)
    yield Person("robot", NOBODY.pw_uid, NOBODY.pw_gid, str(home), shutil.which("bash"))
    shutil.rmtree(home)


def write(person, name, *lines, end="\n"):
    path = pathlib.Path(person.home) / name
    path.write_bytes("".join(line + end for line in lines).encode())
    path.chmod(0o644)


def rows(person, planned=None):
    """List the rows of a person, as (file within the home folder, line, variable, value, shell)."""
    files = shells._read_as((person.uid, person.gid), person.home, "/")
    parsed = [dict(entry, file=path) for path, content in files for entry in shells.assignments(content)]
    answers = person_shells.ask(person, NAMES)
    found = person_shells.list_rows(person, answers, parsed, planned or {}, shells._is_ours)
    return [
        (r["file"].replace(person.home + "/", ""), r["line"], r["variable"], r["value"], r.get("shell", ""))
        for r in found
    ]


def test_a_file_that_another_one_sources_is_found_with_its_line(person):
    write(person, ".bashrc", "case $- in *i*) ;; *) return;; esac", ". ~/robot_env.sh")
    write(person, "robot_env.sh", "MASTER_IP=10.0.0.5", "export ROS_MASTER_URI=http://$MASTER_IP:11311")
    assert rows(person) == [("robot_env.sh", 2, "ROS_MASTER_URI", "http://10.0.0.5:11311", "interactive")]


def test_a_function_counts_if_it_is_called(person):
    write(person, ".bashrc", "sim() { export ROS_IP=1.2.3.4; }", "real() {", " export ROS_HOSTNAME=robot9", "}", "real")
    assert rows(person) == [(".bashrc", 3, "ROS_HOSTNAME", "robot9", "interactive")]


def test_a_variable_that_no_node_gets_is_none(person):
    write(person, ".bashrc", "ROS_IP=10.0.0.5", "export ROS_HOSTNAME=old", "unset ROS_HOSTNAME")
    assert rows(person) == []


def test_a_login_shell_may_have_another_value(person):
    write(person, ".bashrc", "export ROS_IP=10.0.0.1")
    write(person, ".profile", "export ROS_IP=10.0.0.2")
    assert rows(person) == [
        (".bashrc", 1, "ROS_IP", "10.0.0.1", "interactive"),
        (".profile", 1, "ROS_IP", "10.0.0.2", "login"),
    ]


def test_the_ends_of_lines_of_another_system_stay_in_the_value(person):
    write(person, ".bashrc", "export ROS_MASTER_URI=http://10.0.0.5:11311", end="\r\n")
    ((_file, line, _name, value, _shell),) = rows(person)
    assert (line, value) == (1, "http://10.0.0.5:11311\\r")


def test_what_other_programs_read_is_told_as_it_stands(person):
    write(person, ".bashrc", "true")
    write(person, ".pam_environment", "ROS_IP DEFAULT=10.0.0.1")
    write(person, ".zshrc", "export ROS_IP=10.0.0.2")
    assert [row[0] for row in rows(person)] == [".zshrc", ".pam_environment"]


@pytest.mark.slow
@pytest.mark.parametrize("line", ["sleep 1000", "while :; do :; done", "read x < /dev/tty", "exec sleep 1000"])
def test_a_shell_that_hangs_is_ended_and_its_files_are_read(person, line, monkeypatch):
    monkeypatch.setattr(person_shells, "_ASKING", 0.7)
    write(person, ".bashrc", line, "export ROS_IP=10.0.0.1")
    write(person, ".profile", line)
    began = time.monotonic()
    found = rows(person)
    assert time.monotonic() - began < 12
    assert found in ([(".bashrc", 2, "ROS_IP", "10.0.0.1", "")], [(".bashrc", 2, "ROS_IP", "10.0.0.1", "interactive")])


def test_what_stands_in_files_is_told_if_one_of_the_shells_has_no_answer(person):
    write(person, ".bashrc", "export ROS_IP=10.0.0.1", "set -e", "false")
    write(person, ".profile", "export ROS_HOSTNAME=robot")
    assert list(person_shells.ask(person, NAMES)) == ["login"]
    assert rows(person) == [
        (".bashrc", 1, "ROS_IP", "10.0.0.1", ""),
        (".profile", 1, "ROS_HOSTNAME", "robot", "login"),
    ]


def test_megabytes_of_output_and_of_variables_do_no_harm(person, monkeypatch):
    monkeypatch.setattr(person_shells, "_ASKING", 3.0)
    write(person, ".bashrc", "export ROS_IP=10.0.0.1", "head -c 30000000 /dev/zero", "head -c 9000000 /dev/zero >&2")
    assert rows(person) == [(".bashrc", 1, "ROS_IP", "10.0.0.1", "interactive")]
    write(
        person,
        ".bashrc",
        "export ROS_IP=10.0.0.1; export MORE=$(head -c 100000 /dev/zero | tr '\\0' x)",
        "ROS_IP=$MORE",
    )
    ((_file, _line, _name, value, _shell),) = rows(person)
    assert len(value) <= 500


@pytest.mark.slow
def test_nothing_that_a_shell_starts_stays(person):
    mark = f"{time.monotonic_ns() % 10**6 + 10**6}"
    write(person, ".bashrc", f"setsid sleep {mark} &", f"(setsid sleep {mark} & ) ; true")
    assert person_shells.ask(person, NAMES)["interactive"].values == {}
    left = []
    for entry in pathlib.Path("/proc").glob("[0-9]*/cmdline"):
        try:
            left += [entry] if mark.encode() in entry.read_bytes().split(b"\0") else []
        except OSError:
            pass
    assert left == []


def test_the_shell_has_no_terminal_no_input_and_a_clean_environment(person):
    write(
        person, ".bashrc", 'export ROS_IP="$(id -u) $(cat | wc -c) $(tty)"', "export ROS_HOSTNAME=$SECRET_OF_ROOT-$USER"
    )
    os.environ["SECRET_OF_ROOT"] = "x"
    try:
        values = person_shells.ask(person, NAMES)["interactive"].values
    finally:
        del os.environ["SECRET_OF_ROOT"]
    assert values == {"ROS_IP": f"{NOBODY.pw_uid} 0 not a tty", "ROS_HOSTNAME": "-robot"}


def test_root_is_never_asked():
    root = Person("root", 0, 0, "/root", "/bin/bash")
    assert not person_shells.can_ask(root)
    assert shell_program.answer("/bin/bash", person_shells.KINDS, "/root", NAMES, 1.0) == {}
    assert not person_shells.can_ask(root._replace(uid=1000, shell="/usr/bin/xonsh"))


def test_a_shell_without_a_trace_is_told_by_the_line_of_the_parser(person):
    write(person, ".profile", "export ROS_IP=10.0.0.2")
    plain = person._replace(shell=shutil.which("dash") or "/bin/sh")
    assert rows(plain) == [(".profile", 1, "ROS_IP", "10.0.0.2", "login")]


def test_a_value_without_a_line_is_told_unless_everybody_has_it(person):
    fish = person._replace(shell="/usr/bin/fish")
    answers = {"interactive": Seen({"ROS_IP": "10.0.0.1", "ROS_HOSTNAME": "planned"}, {})}
    found = person_shells.list_rows(fish, answers, [], {"ROS_HOSTNAME": "planned"}, shells._is_ours)
    assert [(row["file"], row["line"], row["variable"], row["value"]) for row in found] == [
        ("", 0, "ROS_IP", "10.0.0.1")
    ]


def test_what_the_collection_sets_is_no_line_of_others(person):
    seen = Seen(
        {"ROS_IP": "10.0.0.1"}, {"ROS_IP": ("/opt/ws/etc/catkin/profile.d/1.rosfleet-multimaster.sh", 3, "export")}
    )
    assert person_shells.list_rows(person, {"login": seen}, [], {}, shells._is_ours) == []


@pytest.mark.parametrize("line", ["9" * 40, "1e999", "-5", "true", '"7"'])
def test_a_line_whose_number_is_none_makes_no_answer(person, line, monkeypatch):
    said = f'{{"interactive": [{{"ROS_IP": "1"}}, {{"ROS_IP": ["/x", {line}, "ROS_IP=1"]}}], "login": null}}'
    monkeypatch.setattr(person_shells, "run", lambda *_words: Answer(0, said.encode() + b"\n", ""))
    assert person_shells.ask(person, NAMES) == {}


def test_a_trace_that_a_file_made_up_tells_no_number_of_forty_digits(person):
    made_up = "printf '+\\037x\\037" + "9" * 40 + "\\037ROS_IP=1\\n' >&$BASH_XTRACEFD"
    write(person, ".bashrc", "export ROS_IP=1", made_up)
    assert all(row[1] < 1 << 31 for row in rows(person))


@pytest.mark.parametrize(
    "said", [b"7", b"[]", b'{"login": 7, "interactive": null}', b'{"login": [[], []], "interactive": [7, 7]}']
)
def test_an_answer_that_a_person_made_up_is_none(person, said, monkeypatch):
    answer = type("Answer", (), {"output": said})
    monkeypatch.setattr(person_shells, "run", lambda *_words: answer)
    assert person_shells.ask(person, NAMES) == {}


def passwd(tmp_path, monkeypatch, person):
    """Let the person be the only one of this machine."""
    line = f"{person.name}:x:{person.uid}:{person.gid}::{person.home}:{person.shell}\n"
    monkeypatch.setattr(shells, "text", lambda path, *_most: line if path == "/etc/passwd" else "")


def test_a_shell_without_an_answer_is_named(person, tmp_path, monkeypatch):
    passwd(tmp_path, monkeypatch, person)
    write(person, ".bashrc", ". ~/robot_env.sh")
    write(person, "robot_env.sh", "export ROS_IP=10.0.0.1")
    told = shells.exports()
    assert ("ROS_IP", "interactive") in [(row["variable"], row["shell"]) for row in told["exports"]]
    assert told["silent_shells"] == []
    write(person, ".bashrc", ". ~/robot_env.sh", "exit")
    told = shells.exports()
    assert told["silent_shells"] == [{"person": "robot", "shell": "interactive"}]


def test_files_without_an_answer_are_named(person, tmp_path, monkeypatch):
    passwd(tmp_path, monkeypatch, person)
    monkeypatch.setattr(shells, "_READING", 0.01)  # a home folder on a dead network disk
    assert shells.exports()["silent_shells"] == [{"person": "robot", "shell": "files"}]


def test_a_person_without_a_home_folder_has_shells_without_files(person, tmp_path, monkeypatch):
    homeless = person._replace(home=f"{person.home}/none")
    passwd(tmp_path, monkeypatch, homeless)
    assert shells.exports()["silent_shells"] == []
    assert {kind: seen.values for kind, seen in person_shells.ask(homeless, NAMES).items()} == {
        "interactive": {},
        "login": {},
    }
