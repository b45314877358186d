# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""systemctl as it is called, by a program that stands for it; and the folders that systemd makes for units."""

import os
import time

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.transaction import systemctl, units
from ansible_collections.rosfleet.multimaster.plugins.module_utils._base import commands, deadlines
from ansible_collections.rosfleet.multimaster.plugins.module_utils._base.problem import Problem

SHOWN = """Id=a.service
LoadState=loaded
ActiveState=failed
SubState=failed
Result=exit-code
ExecMainCode={code}
ExecMainStatus=3
MainPID=0
InvocationID=abc
"""


@pytest.fixture
def computer(monkeypatch):
    """Answers by the first words of a command; the commands that were run."""

    class Computer:
        answers = {}
        asked = []
        limits = []

    def run(argv, limit=0.0, **options):
        Computer.asked.append(list(argv))
        Computer.limits.append(limit)
        for words, answer in Computer.answers.items():
            if " ".join(argv).startswith(words):
                return answer
        return commands.Answer(0, b"", "")

    Computer.answers, Computer.asked, Computer.limits = {}, [], []
    monkeypatch.setattr(commands, "run", run)
    return Computer


def answer(text, status=0, error=""):
    return commands.Answer(status, text.encode(), error)


def test_the_state_of_units_with_the_inputs_of_their_processes(computer, monkeypatch):
    monkeypatch.setenv("IGNORED", "x")
    text = SHOWN.format(code=1) + f"\nId=b.service\nActiveState=active\nMainPID={os.getpid()}\n"
    computer.answers["systemctl show"] = answer(text)
    monkeypatch.setattr(systemctl.processes, "environment", lambda pid: {"ROSFLEET_INPUTS": f"of {pid}"})
    found = systemctl.Systemd(1).show(["a.service", "b.service"])
    assert (found["a.service"].Result, found["a.service"].inputs) == ("exit-code", "")
    assert (found["b.service"].ActiveState, found["b.service"].inputs) == ("active", f"of {os.getpid()}")
    assert systemctl.Systemd(1).show([]) == {} and len(computer.asked) == 1


@pytest.mark.parametrize(
    ("age", "overtakes"),
    [
        (-60.0, True),  # seconds after the start of a process that runs for two minutes
        (60.0, False),
        (1.0, False),
        (-1.0, False),  # it may have been read all the same
        (-600.0, False),  # written by a clock that was ahead
        (None, False),
    ],
)
def test_a_file_that_was_written_after_the_start_of_the_process(tmp_path, monkeypatch, age, overtakes):
    path, began = tmp_path / "one.json", time.time() - 120
    if age is not None:
        path.write_text("{}")
        os.utime(path, (began - age, began - age))
    monkeypatch.setattr(systemctl.units, "files_read", lambda content: [str(tmp_path), str(path)])
    monkeypatch.setattr(systemctl.processes, "start_time", lambda pid: began)
    state = units.UnitState(MainPID="7")
    assert systemctl.Systemd(1).find_newer_file("", state) == (str(path) if overtakes else "")
    assert systemctl.Systemd(1).find_newer_file("", units.UnitState(MainPID="0")) == ""
    monkeypatch.setattr(systemctl.processes, "start_time", lambda pid: None)
    assert systemctl.Systemd(1).find_newer_file("", state) == ""


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (
            lambda systemd: systemd.call("enable", "--", "a.service"),
            "'systemctl enable -- a.service' failed: \"No bus\".",
        ),
        (
            lambda systemd: systemd.properties(["a.service"], ["Id", "Names"]),
            "'systemctl show --property=Id,Names -- a.service' failed: \"No bus\".",
        ),
        (lambda systemd: systemd.unit_path(), "'systemctl show --property=UnitPath' failed: \"No bus\"."),
    ],
)
def test_a_failure_is_a_sentence(computer, call, said):
    computer.answers["systemctl"] = answer("", 1, "No bus.")
    with pytest.raises(Problem) as caught:
        call(systemctl.Systemd(1))
    assert str(caught.value) == said


def test_the_folders_of_units(computer):
    computer.answers["systemctl show"] = answer("UnitPath=/etc/systemd/system /run/systemd/system\n")
    assert systemctl.Systemd(1).unit_path() == ["/etc/systemd/system", "/run/systemd/system"]


@pytest.mark.parametrize(
    ("status", "code", "journal", "said"),
    [
        (1, 1, "one\ntwo\n", "did not start: it is failed (failed), result exit-code, exit status 3. The end of its "),
        (1, 2, "", "did not start: it is failed (failed), result exit-code, killed by signal 3. Its journal is empty."),
        (
            *(-1, 0, ""),
            "did not start within 3 s (timeout; of the role: services_timeout): it is failed (failed), result exit-code. Its journal is empty.",
        ),
    ],
)
def test_a_unit_that_does_not_start_is_explained(computer, monkeypatch, status, code, journal, said):
    monkeypatch.setattr(deadlines, "measure_pace", list)
    monkeypatch.setattr(deadlines, "_measured", [2.0])  # a busy computer
    computer.answers["systemctl show"] = answer(SHOWN.format(code=code))
    computer.answers["systemctl start"] = answer("", status, "it says little")
    computer.answers["journalctl --quiet"] = answer(journal)
    with pytest.raises(Problem) as caught:
        systemctl.Systemd(1.5).bring("start", "a.service")
    assert str(caught.value).startswith("The unit a.service " + said)
    assert not journal or str(caught.value).endswith('journal: "one" "two"')


def test_a_start_gets_more_time_on_a_busy_computer_within_bounds(computer, monkeypatch):
    monkeypatch.setattr(deadlines, "measure_pace", list)
    for pace in (1.0, 2.0, 6.0):
        monkeypatch.setattr(deadlines, "_measured", [pace])
        systemctl.Systemd(90).bring("start", "a.service")
    assert computer.limits == [90.0, 180.0, 300.0]


def test_there_is_one_block_for_each_unit(computer):
    text = 'Id=a.service\nLoadError=x "y=z"\nMainPID=0\n\nId=b.service\nMainPID=7\n'
    computer.answers["systemctl show"] = answer(text)
    systemd = systemctl.Systemd(1)
    assert systemd.properties(["a.service", "b.service"], ["Id"]) == [
        {"Id": "a.service", "LoadError": 'x "y=z"', "MainPID": "0"},
        {"Id": "b.service", "MainPID": "7"},
    ]
    with pytest.raises(Problem, match="expected 3"):
        systemd.properties(["a.service", "b.service", "c.service"], ["Id"])


def test_state_directories():
    assert systemctl.state_directories({"StateDirectory": "", "DynamicUser": "yes"}) == ([], [])
    assert systemctl.state_directories({"StateDirectory": "x", "DynamicUser": "no", "RuntimeDirectory": "r"}) == (
        ["/var/lib/x"],
        [],
    )
    paths, parents = systemctl.state_directories(
        {"StateDirectory": "a/b:link", "LogsDirectory": "l", "DynamicUser": "yes"}
    )
    assert paths == ["/var/lib/a/b", "/var/lib/private/a/b", "/var/log/l", "/var/log/private/l"]
    assert parents == ["/var/lib/a", "/var/lib/private", "/var/lib/private/a", "/var/log/private"]
    kept = {
        "RuntimeDirectory": "r",
        "RuntimeDirectoryPreserve": "yes",
        "ConfigurationDirectory": "c",
        "DynamicUser": "yes",
    }
    assert systemctl.state_directories(kept)[0] == ["/run/r", "/run/private/r", "/etc/c"]


def test_trees_and_parents_go_but_nothing_else(tmp_path):
    (tmp_path / "private" / "x" / "deep").mkdir(parents=True)
    (tmp_path / "private" / "x" / "deep" / "file").touch()
    (tmp_path / "x").symlink_to("private/x")
    (tmp_path / "outside").mkdir()
    (tmp_path / "shared" / "theirs").mkdir(parents=True)
    systemctl.remove_trees(str(tmp_path / name) for name in ("x", "private/x", "missing"))
    systemctl.remove_parents(str(tmp_path / name) for name in ("private", "shared", "missing"))
    assert sorted(os.listdir(tmp_path)) == ["outside", "shared"]
