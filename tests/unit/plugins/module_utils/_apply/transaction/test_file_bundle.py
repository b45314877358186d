# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Runs of managed_files on a folder that stands for the machine: what they return, and killed at every call."""

import os
import subprocess

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.transaction import atomic
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.transaction.file_bundle import ManagedFiles
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.transaction.transaction import StepFailure
from ansible_collections.rosfleet.multimaster.plugins.module_utils._base import commands
from ansible_collections.rosfleet.multimaster.plugins.module_utils._base.problem import Problem
from mentioned import mentions


class Machine:
    """A folder with the files and the records."""

    def __init__(self, folder):
        self.root, self.records = folder / "root", folder / "records"
        self.root.mkdir(parents=True)

    def run(self, files, validate=(), reload=None):
        listed = [
            {"path": str(self.root / name), "content": content, "mode": "0644", "validate": list(validate)}
            for name, content in files.items()
        ]
        options = {"bundle": "b", "files": listed, "brief": [], "records": str(self.records), "reload": reload}
        return ManagedFiles(options)

    def apply(self, files):
        run = self.run(files)
        run.apply()
        return run

    def state(self):
        """Everything below the folders: path -> content, None for a folder."""
        return {
            os.path.relpath(path, self.root): None if path.is_dir() else path.read_bytes()
            for folder in (self.root, self.records)
            for path in folder.rglob("*")
        }


@pytest.fixture
def machine(tmp_path):
    return Machine(tmp_path)


@pytest.mark.parametrize("kept", [{}, {"b": "B"}, {"b": "other"}])
def test_what_a_killed_run_removed_is_gone_for_good_before_the_record_forgets_it(machine, killed_at, synced, kept):
    machine.apply({"etc/a": "A", "b": "B"})
    step = 0
    while (machine.root / "etc/a").exists():
        step += 1
        assert killed_at(step, machine.apply, kept), "it was never killed right after the removal"
    folder = str(machine.root / "etc")
    synced.clear()
    assert machine.apply(kept).changed
    records = [number for number, path in enumerate(synced) if path.startswith(str(machine.records))]
    assert folder in synced and synced.index(folder) < records[-1]


def test_the_return_values(machine):
    run = machine.run({"etc/a": "A", "b": "B"})
    assert run.changed and run.refusals == [] and machine.state() == {}
    assert mentions(run.summary(check_mode=True), "2", "0")
    run.apply()
    assert mentions(run.summary(check_mode=False), "2", "0")
    result = run.result()
    assert result["files"][0] == {"path": str(machine.root / "etc/a"), "state": "written", "mode": "0644"}
    assert (result["removed"], result["folders_made"]) == ([], [str(machine.root / "etc")])
    assert [entry["after"] for entry in run.difference] == ["A", "B"]
    assert not machine.apply({"etc/a": "A", "b": "B"}).changed
    gone = machine.apply({}).result()
    assert (gone["removed"], gone["folders_removed"]) == (
        [str(machine.root / "b"), str(machine.root / "etc/a")],
        [str(machine.root / "etc")],
    )
    assert machine.state() == {}


@pytest.fixture(name="systemctl")
def _systemctl(monkeypatch):
    """The commands that systemd was told, with the status that it gives."""
    said = []

    def run(argv, limit):
        said.append(argv)
        return commands.Answer(run.status, b"", "Unit x.service is masked.\n" if run.status else "")

    run.status = 0
    monkeypatch.setattr(commands, "run", run)
    return said, run


def test_a_service_reads_its_files_again_when_one_changes(machine, systemctl):
    told = systemctl[0]
    reload = {"service": "x.service", "folder": str(machine.root / "etc/"), "due": False}

    def apply(files, **more):
        told.clear()
        run = machine.run(files, reload={**reload, **more})
        run.apply()
        assert run.result()["reloaded"] == ("x.service" if told else "")
        return run.changed, told == [["systemctl", "reload", "x.service"]]

    assert apply({"etc/a": "A", "b": "B"}) == (True, True)
    assert apply({"etc/a": "A", "b": "B"}) == (False, False)
    assert apply({"etc/a": "A", "b": "C"}) == (True, False)  # none of its files
    assert apply({"etc/a": "A", "b": "C"}, due=True) == (True, True)
    assert apply({"b": "C"}) == (True, True)  # one of them is gone
    assert apply({"etc/a": "A", "b": "C"}, service="") == (True, False)  # there is no such service here


@pytest.mark.parametrize("due", [False, True])
def test_a_service_that_is_not_here_leaves_nothing_pending(machine, due):
    reload = {"service": "", "folder": str(machine.root), "due": due}
    machine.run({"a": "A"}, reload=reload).apply()
    assert b"pending" not in b"".join(path.read_bytes() for path in machine.records.iterdir())
    machine.run({}, reload=reload).apply()
    assert not list(machine.root.parent.glob("records/*")), "no record is left of what is gone"


def test_a_service_that_is_not_reloaded_is_a_sentence(machine, systemctl):
    systemctl[1].status = 1
    run = machine.run({"a": "A"}, reload={"service": "x.service", "folder": str(machine.root), "due": False})
    with pytest.raises(Problem) as problem:
        run.apply()
    assert mentions(str(problem.value), "x.service", "reloaded")
    assert run.failure(problem.value) == {"changed": True} and "a" in machine.state()


@pytest.mark.parametrize("files", [{"a": "A"}, {}], ids=["written", "removed"])
def test_a_failed_reload_is_done_by_the_next_run(machine, systemctl, files):
    """A failure must not be forgotten: the files are right by then, and the service still has the old ones."""
    told, run_command = systemctl
    if not files:
        machine.apply({"a": "A"})
    reload = {"service": "x.service", "folder": str(machine.root), "due": False}
    run_command.status = 1
    with pytest.raises(Problem):
        machine.run(files, reload=reload).apply()
    run_command.status = 0
    assert machine.run(files, reload=reload).result()["reloaded"] == "x.service"  # as check mode shows it
    told.clear()
    again = machine.run(files, reload=reload)
    again.apply()
    assert again.changed and told == [["systemctl", "reload", "x.service"]]
    assert not machine.run(files, reload=reload).changed
    assert bool(list(machine.root.parent.glob("records/*"))) == bool(files)  # no record is left of what is gone


def test_a_run_killed_before_the_reload_is_ended_by_the_next_one(machine, monkeypatch):
    reload = {"service": "x.service", "folder": str(machine.root), "due": False}

    class Killed(BaseException):
        pass

    def kill(argv, limit):
        raise Killed

    monkeypatch.setattr(commands, "run", kill)
    with pytest.raises(Killed):
        machine.run({"a": "A"}, reload=reload).apply()
    assert machine.run({"a": "A"}, reload=reload).result()["reloaded"] == "x.service"


def test_a_content_that_its_command_refuses_is_a_sentence(machine):
    command = ["sh", "-c", "if grep -q bad; then echo 'line 1:'; echo no >&2; exit 1; fi"]
    run = machine.run({"a": "good", "b": "bad"}, validate=command)
    (refusal,) = run.refusals
    assert mentions(refusal, f"{machine.root}/b", " ".join(command), "line 1: no", "nothing was changed")
    assert machine.state() == {}


@pytest.mark.parametrize(
    ("command", "said"),
    [
        (["/no/such/check"], "could not be started: No such file or directory"),
        (["/etc/passwd"], "Permission denied"),
        (["a\0b"], "could not be started: embedded null byte"),
        (["false"], "(status 1)"),
        (["sh", "-c", "kill $$"], "(status -15)"),
    ],
)
def test_a_command_that_cannot_check_is_a_sentence(machine, command, said):
    (sentence,) = machine.run({"a": "x"}, validate=command).refusals
    assert said in sentence and "nothing was changed" in sentence


def test_a_command_may_leave_its_input_unread(machine):
    assert machine.run({"a": "x" * 1_000_000}, validate=["true"]).refusals == []


def test_a_machine_that_cannot_be_read_is_a_sentence(machine, monkeypatch):
    def broken(path):
        raise OSError(5, "Input/output error", path)

    (machine.root / "a").write_text("A")
    monkeypatch.setattr(atomic, "read_bytes", broken)
    with pytest.raises(Problem, match="Input/output error"):
        machine.run({"a": "A"})


def test_a_failure_is_told_with_what_is_left_of_it(machine, monkeypatch):
    machine.apply({"a": "A", "b": "B"})
    before, write = machine.state(), atomic.write_by_rename

    def full(path, content, *rest, **more):
        if path.endswith("/b") and content == b"B2":
            raise OSError(28, "No space left on device", path)
        write(path, content, *rest, **more)

    monkeypatch.setattr(atomic, "write_by_rename", full)
    run = machine.run({"a": "A2", "b": "B2"})
    with pytest.raises(StepFailure) as caught:
        run.apply()
    assert mentions(str(caught.value), f"{machine.root}/b", "writable")
    assert run.failure(caught.value) == {"changed": False} and machine.state() == before

    def worse(path, content, *rest, **more):
        if content == b"A":
            raise OSError(30, "Read-only file system", path)
        full(path, content, *rest, **more)

    monkeypatch.setattr(atomic, "write_by_rename", worse)
    with pytest.raises(StepFailure) as caught:
        machine.run({"a": "A2", "b": "B2"}).apply()
    assert mentions(str(caught.value), f"{machine.root}/a", "system")
    assert run.failure(caught.value) == {"changed": True} and run.failure(Problem("x")) == {}
    monkeypatch.undo()
    assert [item.state for item in machine.apply({"a": "A", "b": "B"}).files.items] == ["written", "unchanged"]


FIRST = {"lib/a": "A", "lib/deep/b": "B", "c": "C"}


@pytest.mark.slow
@pytest.mark.parametrize("wanted", [FIRST, {"lib/a": "A2", "new/d": "D"}, {"c/now/a/folder": "X"}, {}])
@pytest.mark.parametrize("first", [{}, FIRST])
def test_kill_at_any_call_leaves_what_the_next_run_repairs(tmp_path, killed_at, first, wanted):
    if "c" in first and "c/now/a/folder" in wanted:
        first = {"lib/a": "A"}
    killed, step = True, 0
    while killed:
        machine = Machine(tmp_path / str(step))
        (machine.root / "theirs").write_text("theirs")
        machine.apply(first)
        killed = killed_at(step, machine.apply, wanted)
        machine.apply(wanted)
        files = {name: text for name, text in machine.state().items() if text is not None and name[0] != "."}
        assert files == {"theirs": b"theirs", **{name: text.encode() for name, text in wanted.items()}}, step
        assert not machine.apply(wanted).changed, step
        machine.apply({})
        assert machine.state() == {"theirs": b"theirs"}, step
        step += 1
    assert step > 15 or first == wanted or not wanted


def owned(machine, owner, mode="0640", content="A"):
    """A run with one file that has an owner."""
    listed = [{"path": str(machine.root / "a"), "content": content, "mode": mode, "validate": [], **owner}]
    return ManagedFiles({"bundle": "b", "files": listed, "brief": [], "records": str(machine.records)})


@pytest.mark.skipif(os.geteuid() != 0, reason="only root gives files away")
def test_owner_and_group_are_given_kept_and_changed(machine):
    path = machine.root / "a"

    def state_of(run):
        state = run.files.items[0].state
        run.apply()
        return state, (path.stat().st_uid, path.stat().st_gid), run.files.notes

    assert state_of(owned(machine, {"owner": "1234", "group": "5678"})) == ("written", (1234, 5678), [])
    assert not owned(machine, {"owner": "1234", "group": "5678"}).changed
    assert state_of(owned(machine, {"owner": "1234"})) == ("written", (1234, 0), [])
    os.chown(str(path), 7, 7)
    state, owner, notes = state_of(owned(machine, {"owner": "1234"}))
    assert (state, owner) == ("edited", (1234, 0)) and "by hand" in notes[0]
    assert state_of(owned(machine, {})) == ("written", (0, 0), [])
    assert not owned(machine, {}).changed
    assert state_of(owned(machine, {"group": "9"}, mode="u=rw,g=r,o=")) == ("written", (0, 9), [])


def test_a_file_of_others_with_another_owner_is_in_the_way(machine):
    (machine.root / "a").write_text("A")
    (machine.root / "a").chmod(0o640)
    with pytest.raises(Problem, match="with mode 0640 and owner 1234:5678"):
        owned(machine, {"owner": "1234", "group": "5678"})
    assert owned(machine, {}).files.items[0].state == "foreign"


def test_a_user_without_root_cannot_give_files_away(machine, monkeypatch):
    monkeypatch.setattr(os, "geteuid", lambda: 1000)
    said = owned(machine, {"owner": "1234"}).refusals
    assert said[-1] == "Nothing was changed." and "another owner or group" in said[0] and "become: true" in said[0]


@pytest.fixture
def immutable(machine):
    """Makes a path immutable until the end of the test."""
    paths = []

    def lock(path):
        if subprocess.run(["chattr", "+i", str(path)], capture_output=True, check=False).returncode:
            pytest.skip("no flags on this file system")
        paths.append(path)

    yield lock
    for path in paths:
        subprocess.run(["chattr", "-i", str(path)], check=True)


def test_an_immutable_file_is_refused_before_anything_changes(machine, immutable):
    machine.apply({"a": "A", "b": "B"})
    immutable(machine.root / "b")
    for wanted in ({"a": "A2", "b": "B2"}, {"a": "A2"}):
        said = machine.run(wanted).refusals
        assert len(said) == 2 and f"run 'chattr -i {machine.root}/b'" in said[0]
    assert machine.run({"a": "A2", "b": "B"}).refusals == []


def test_a_file_that_was_never_touched_is_not_said_to_be_lost(machine, immutable):
    """The file becomes immutable after the plan."""
    machine.apply({"a": "A", "b": "B"})
    before, run = machine.state(), machine.run({"a": "A2", "b": "B2"})
    immutable(machine.root / "b")
    with pytest.raises(StepFailure, match=r"chattr -i.*Everything that this run had changed was put back\.$") as caught:
        run.apply()
    assert caught.value.left == [] and machine.state() == before


def test_attributes_of_a_file_come_back_with_it(machine, monkeypatch):
    machine.apply({"a": "A", "b": "B"})
    os.setxattr(str(machine.root / "a"), "user.colour", b"blue")
    run, write = machine.run({"b": "B2"}), atomic.write_by_rename

    def full(path, content, *rest, **more):
        if content == b"B2":
            raise OSError(28, "No space left on device", path)
        write(path, content, *rest, **more)

    monkeypatch.setattr(atomic, "write_by_rename", full)
    with pytest.raises(StepFailure):
        run.apply()
    assert os.getxattr(str(machine.root / "a"), "user.colour") == b"blue"


def test_a_pipe_in_a_folder_that_is_read_does_not_hang(machine):
    os.mkfifo(str(machine.root / "a"))
    with pytest.raises(Problem, match="a device, pipe or socket"):
        machine.run({"a": "A"})
    (machine.records).mkdir()
    os.mkfifo(str(machine.records / "files-other.json"))
    with pytest.raises(Problem, match=r"files-other.json cannot be read \(Is a pipe"):
        machine.run({"b": "B"})
