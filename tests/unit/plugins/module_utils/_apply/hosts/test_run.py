# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Runs of hosts_entries on a file of the test, killed at every call. (test_file.py runs the module as a program.)"""

import errno
import functools
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.hosts import cloud_init
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.hosts import run as run_module
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.hosts.run import HostsRun
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.transaction import atomic
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.transaction.record import Record
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.transaction.transaction import StepFailure
from ansible_collections.rosfleet.multimaster.plugins.module_utils._base.problem import Problem
from mentioned import mentions
from processes import with_paths

OLD = b"127.0.0.1 localhost\n127.0.1.1 kobuki1computer\n"
FIRST = [{"address": "192.168.1.229", "names": ["kobuki1computer"]}]
SECOND = [{"address": "192.168.1.239", "names": ["kobuki2computer"]}]


class Machine:
    """A folder with the file and the records."""

    def __init__(self, folder, content):
        self.hosts, self.records = folder / "etc" / "hosts", folder / "records"
        self.hosts.parent.mkdir(parents=True)
        if content is not None:
            self.hosts.write_bytes(content)

    def run(self, entries):
        options = {"entries": entries, "path": str(self.hosts), "records": str(self.records)}
        options.update({"own_name": "kobuki1computer", "on_conflict": "fail", "backup": False})
        return HostsRun(options, back_up=None)

    def apply(self, entries):
        self.run(entries).apply()

    def found(self):
        """The content of the file, and the names of all files and folders."""
        folder = self.hosts.parent.parent
        content = self.hosts.read_bytes() if self.hosts.exists() else None
        return content, sorted(str(path.relative_to(folder)) for path in folder.rglob("*"))


@pytest.mark.slow
@pytest.mark.parametrize("rename", [True, False], ids=["rename", "in place"])
@pytest.mark.parametrize("wanted", [FIRST, SECOND, []])
@pytest.mark.parametrize("first", [FIRST, []])
@pytest.mark.parametrize("content", [OLD, None], ids=["a file", "no file"])
def test_kill_at_any_call_leaves_what_the_next_run_repairs(
    tmp_path, monkeypatch, killed_at, content, first, wanted, rename
):
    """The next run makes the file that an undisturbed run makes, and the removal leaves it as it was at first."""
    write = atomic.write_by_rename

    def mounted(path, *rest, **more):
        if path.endswith("hosts"):
            raise OSError(errno.EBUSY, "Device or resource busy", path)
        write(path, *rest, **more)

    undisturbed = Machine(tmp_path / "undisturbed", content)
    undisturbed.apply(wanted)
    killed, step = True, 0
    while killed:
        machine = Machine(tmp_path / str(step), content)
        before = machine.found()
        machine.apply(first)
        if not rename:
            monkeypatch.setattr(atomic, "write_by_rename", mounted)
        if rename or machine.hosts.exists():
            killed = killed_at(step, machine.apply, wanted)
        else:  # nothing to write in place
            killed = False
        monkeypatch.setattr(atomic, "write_by_rename", write)
        machine.apply(wanted)
        assert machine.found() == undisturbed.found(), step
        assert not machine.run(wanted).changed, step
        machine.apply([])
        assert machine.found() == before, step
        step += 1
    assert step > 2 or wanted == first or (content is None and not (first and wanted))


def test_the_return_values_of_a_failure_are_those_of_a_conflict(tmp_path):
    machine = Machine(tmp_path, OLD + b"10.0.0.9 kobuki2computer\n")
    run = machine.run(SECOND)
    assert len(run.refusals) == 2 and run.changed
    failed = run.failure(None)
    assert (failed["changed"], failed["repaired"], failed["conflicts"][0]["found"]) == (False, False, "10.0.0.9")
    assert machine.run(FIRST).failure(None) == {}


@pytest.mark.skipif(os.geteuid() != 0, reason="only root gives rights away")
def test_a_user_is_told_to_become_root_before_anything_changes():
    """In /run, since the folders of pytest are closed to other users."""
    folder = Path(tempfile.mkdtemp(dir="/run"))
    try:
        machine = Machine(folder / "machine", OLD)
        folder.chmod(0o755)
        reader, writer = os.pipe()
        child = os.fork()
        if child == 0:
            os.setuid(65534)
            os.write(writer, " ".join(machine.run(FIRST).refusals).encode())
            os._exit(0)
        os.waitpid(child, 0)
        said = os.read(reader, 1000).decode()
        assert f"{machine.hosts.parent} is not writable for the user 65534" in said
        assert "run as root (become: true). Nothing was changed." in said
    finally:
        shutil.rmtree(str(folder))


# cloud-init

PLAN_FILES = cloud_init.plan_files


@pytest.fixture
def guarded(tmp_path, monkeypatch):
    """Makes machines whose hosts file is that of the system, and that have cloud-init."""

    def make(name, installed=True):
        folder = tmp_path / name
        machine = Machine(folder, OLD)
        if installed:
            (folder / "etc" / "cloud").mkdir()
        monkeypatch.setattr(run_module, "SYSTEM", str(machine.hosts))

        monkeypatch.setattr(run_module.cloud_init, "plan_files", functools.partial(PLAN_FILES, root=str(folder)))
        monkeypatch.setattr(run_module, "resolve", lambda bindings: [{} for binding in bindings])
        return machine

    return make


CONFIGURATION = "etc/rosfleet-multimaster/cloud-init.cfg"
DROP_IN = "etc/systemd/system/{}.service.d/10-rosfleet-multimaster.conf"


def test_cloud_init_is_kept_away_while_there_are_bindings(guarded, tmp_path):
    machine = guarded("computer")
    before = machine.found()
    run = machine.run(FIRST)
    assert run.changed and run.summary(True).count("cloud-init would be kept from writing the file at boot.") == 1
    assert [entry["after_header"].rpartition("/")[2] for entry in run.result()["diff"]] == [
        "hosts",
        "cloud-init.cfg",
        "10-rosfleet-multimaster.conf",
        "10-rosfleet-multimaster.conf",
    ]
    run.apply()
    root = tmp_path / "computer"
    assert (root / CONFIGURATION).read_text().endswith("\nmanage_etc_hosts: false\n")
    for unit in ("cloud-init", "cloud-init-main"):
        text = (root / DROP_IN.format(unit)).read_text()
        assert text.endswith("\n[Service]\nEnvironment=CLOUD_CFG=/etc/rosfleet-multimaster/cloud-init.cfg\n")
    assert {item["state"] for item in run.result()["cloud_init"]} == {"written"}
    assert not machine.run(FIRST).changed
    machine.apply([])
    assert machine.found() == before


def test_cloud_init_that_comes_later_or_goes_is_noticed(guarded, tmp_path):
    machine = guarded("computer", installed=False)
    machine.apply(FIRST)
    assert machine.run(FIRST).result()["cloud_init"] == []
    (tmp_path / "computer" / "etc" / "cloud").mkdir()
    machine.apply(FIRST)
    assert (tmp_path / "computer" / CONFIGURATION).exists()
    (tmp_path / "computer" / CONFIGURATION).write_text("manage_etc_hosts: true\n")
    states = {item["state"] for item in machine.run(FIRST).result()["cloud_init"]}
    assert states == {"edited", "unchanged"}
    machine.apply(FIRST)
    assert not machine.run(FIRST).changed
    (tmp_path / "computer" / "etc" / "cloud").rmdir()
    machine.apply(FIRST)
    assert not (tmp_path / "computer" / CONFIGURATION).exists()


def test_a_file_that_is_not_the_systems_skips_cloud_init(guarded, tmp_path, monkeypatch):
    machine = guarded("computer")
    machine.apply(FIRST)
    monkeypatch.setattr(run_module, "SYSTEM", "/etc/hosts.of.somebody")
    machine.apply([])
    assert (tmp_path / "computer" / CONFIGURATION).exists()


@pytest.mark.costly
@pytest.mark.parametrize("wanted", [SECOND, []])
@pytest.mark.parametrize("first", [FIRST, []])
def test_kill_at_any_call_with_cloud_init(guarded, killed_at, first, wanted):
    undisturbed = guarded("undisturbed")
    undisturbed.apply(wanted)
    expected = undisturbed.found()
    killed, step = True, 0
    while killed:
        machine = guarded(str(step))
        before = machine.found()
        machine.apply(first)
        killed = killed_at(step, machine.apply, wanted)
        machine.apply(wanted)
        assert machine.found() == expected, step
        assert not machine.run(wanted).changed, step
        machine.apply([])
        assert machine.found() == before, step
        step += 1


def test_a_hosts_file_that_cannot_be_written_removes_the_guard(guarded, monkeypatch):
    machine = guarded("computer")
    before, write = machine.found(), atomic.write_by_rename

    def full(path, *rest, **more):
        if path == str(machine.hosts):
            raise OSError(errno.ENOSPC, "No space left on device", path)
        write(path, *rest, **more)

    monkeypatch.setattr(atomic, "write_by_rename", full)
    with pytest.raises(StepFailure, match=r"which has its old content; .*: make room on its file system\.$"):
        machine.apply(FIRST)
    assert machine.found() == before


def test_a_record_that_fails_at_the_end_restores_the_hosts_file(guarded, monkeypatch):
    machine = guarded("computer")
    before, save, calls = machine.found(), Record.save, []

    def full_at_the_end(record, data):
        if record.path.endswith("files-hosts_entries.json"):
            calls.append(data)
            if len(calls) == 2:
                raise OSError(errno.ENOSPC, "No space left on device", record.path)
        save(record, data)

    monkeypatch.setattr(Record, "save", full_at_the_end)
    with pytest.raises(StepFailure):
        machine.apply(FIRST)
    assert len(calls) == 3 and machine.found() == before


def test_without_cloud_init_its_code_is_not_even_loaded():
    """It was half of what the module loads."""
    code = f"import sys; import {HostsRun.__module__}; print([name for name in sys.modules if name.endswith('_hosts.guard')])"
    environment = with_paths()
    assert subprocess.check_output([sys.executable, "-c", code], env=environment) == b"[]\n"


@pytest.mark.parametrize(("said", "found"), [(["192.168.9.9"], "192.168.9.9"), ([], "nothing")])
def test_a_name_that_libc_answers_in_another_way_is_a_sentence(tmp_path, monkeypatch, said, found):
    machine = Machine(tmp_path, OLD)
    monkeypatch.setattr(run_module, "SYSTEM", str(machine.hosts))
    monkeypatch.setattr(cloud_init, "plan_files", lambda wanted, records: None)
    monkeypatch.setattr(run_module, "resolve", lambda bindings: iter([{"kobuki1computer": said}]))
    run = machine.run(FIRST)
    with pytest.raises(Problem) as problem:
        run.apply()
    assert mentions(str(problem.value), "kobuki1computer", found, machine.hosts, "192.168.1.229", "/etc/nsswitch.conf")
    result = run.failure(problem.value)
    assert (result["changed"], result["unresolved"][0]["found"]) == (True, said)
    with pytest.raises(Problem):  # the next run looks again
        machine.run(FIRST).apply()
    monkeypatch.setattr(run_module, "resolve", lambda bindings: iter([{"kobuki1computer": ["192.168.1.229"]}]))
    machine.run(FIRST).apply()
