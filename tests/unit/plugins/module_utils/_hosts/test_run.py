# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Runs of hosts_entries on a file of the test, killed at every call. (test_file.py runs the module as a program.)"""

import errno

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._changes import atomic
from ansible_collections.rosfleet.multimaster.plugins.module_utils._hosts.run import Run

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
        return Run({**options, "own_name": "kobuki1computer", "on_conflict": "fail"})

    def apply(self, entries):
        self.run(entries).apply()

    def found(self):
        """The content of the file, and the names of all files and folders."""
        folder = self.hosts.parent.parent
        content = self.hosts.read_bytes() if self.hosts.exists() else None
        return content, sorted(str(path.relative_to(folder)) for path in folder.rglob("*"))


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
