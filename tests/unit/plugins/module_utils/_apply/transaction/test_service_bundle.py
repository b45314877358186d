# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Runs of managed_services with a systemd that is a file: what they return, undone, and killed at every call."""

import errno
import json
import os
import subprocess

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.transaction import unit_steps
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.transaction.service_bundle import (
    ManagedServices,
)
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.transaction.transaction import StepFailure
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.transaction.units import (
    UnitState,
    read_inputs,
)
from ansible_collections.rosfleet.multimaster.plugins.module_utils._base.problem import Problem
from mentioned import mentions

CORE, SYNC = "core.service", "sync.service"


def text(inputs, more=""):
    return f"[Service]\nEnvironment=ROSFLEET_INPUTS={inputs}\n{more}\n[Install]\nWantedBy=multi-user.target\n"


class FakeSystemd:
    """A systemd whose units are kept in a file, so that a run in another process can be killed.

    Every change goes over os.rename, where the run may be killed. A unit whose text has "bad" in it does not start.
    """

    def __init__(self, folder):
        self.folder, self.path = folder / "system", folder / "systemd.json"
        self.folder.mkdir(parents=True)
        self.path.write_text("{}")

    def known(self):
        return json.loads(self.path.read_text())

    def change(self, name, **changes):
        known = self.known()
        known.setdefault(name, {"active": "inactive", "enabled": False, "text": None, "invocation": 0}).update(changes)
        self.path.with_suffix(".new").write_text(json.dumps(known))
        os.rename(self.path.with_suffix(".new"), self.path)

    def text(self, name):
        """The text that systemd has read: a unit that does not run is read again whenever it is asked for."""
        unit = self.known().get(name, {"text": None, "active": "inactive"})
        if unit["active"] == "active" and unit["text"] is not None:
            return unit["text"]
        return self.on_disk(name)

    def on_disk(self, name):
        file = self.folder / name
        return file.read_text() if file.exists() else None

    def runs(self):
        return True

    def find_newer_file(self, content, state):
        """The file that the unit's text names as `behind <path>`, as long as it runs since its first start."""
        path = content.partition("behind ")[2].split("\n")[0]
        return path if state.InvocationID == "1" else ""

    def unit_path(self):
        return [str(self.folder)]

    def properties(self, names, wanted):
        return [{} for name in names]

    def show(self, names):
        shown = {}
        for name in names:
            unit = self.known().get(name, {"active": "inactive", "enabled": False, "invocation": 0})
            read = self.text(name)
            runs = unit["active"] == "active"
            shown[name] = UnitState(
                LoadState="not-found" if read is None else "loaded",
                ActiveState=unit["active"],
                SubState="running" if runs else "dead",
                UnitFileState=("enabled" if unit["enabled"] else "disabled") if read is not None else "",
                FragmentPath="" if read is None else str(self.folder / name),
                NeedDaemonReload="yes" if read != self.on_disk(name) else "no",
                MainPID="7" if runs else "0",
                NRestarts="0",
                InvocationID=str(unit["invocation"]),
                inputs=unit.get("inputs", "") if runs else "",
            )
        return shown

    def call(self, verb, *arguments):
        if verb == "daemon-reload":
            for name in self.known():
                self.change(name, text=self.on_disk(name))
            return
        for name in (argument for argument in arguments if argument.endswith(".service")):
            if verb in ("enable", "reenable", "disable"):
                self.change(name, enabled=verb != "disable")
            elif verb == "stop":
                self.change(name, active="inactive")
            else:
                raise AssertionError(verb)

    def try_call(self, verb, *names):
        for name in names:
            if verb in ("stop", "disable") and name in self.known():
                self.call(verb, name)

    def bring(self, verb, name):
        unit = self.known().get(name, {"active": "inactive", "invocation": 0})
        if verb == "start" and unit["active"] == "active":
            return
        read = self.on_disk(name) if unit["active"] != "active" else self.text(name)
        good = read is not None and "bad" not in read
        self.change(
            name,
            active="active" if good else "failed",
            text=read,
            invocation=unit["invocation"] + 1,
            inputs=read_inputs(read or ""),
        )
        if not good:
            raise Problem(f"The unit {name} did not {verb}: it is failed.")

    def explain(self, name):
        return ": explained."


class Computer:
    """A machine with this systemd; runs of the module on it."""

    def __init__(self, folder):
        self.systemd = FakeSystemd(folder)
        self.records = folder / "records"

    def run(self, units):
        listed = [{"name": name, "content": text, "enabled": True, "started": True} for name, text in units.items()]
        options = {"bundle": "b", "units": listed, "unit_folder": str(self.systemd.folder)}
        return ManagedServices({**options, "timeout": 1, "records": str(self.records)}, self.systemd)

    def apply(self, units):
        run = self.run(units)
        run.apply()
        return run

    def running(self):
        """unit -> (whether it is enabled, the inputs with which it runs), of those that are active or enabled"""
        return {
            name: (unit["enabled"], unit["inputs"] if unit["active"] == "active" else None)
            for name, unit in self.systemd.known().items()
            if unit["enabled"] or unit["active"] == "active"
        }

    def files(self):
        return {path.name: path.read_text() for path in self.systemd.folder.iterdir()}

    def record(self):
        path = self.records / "services-b.json"
        return json.loads(path.read_text()) if path.exists() else {}


@pytest.fixture(autouse=True)
def _at_once(monkeypatch):
    monkeypatch.setattr(unit_steps, "SETTLE", 0)


@pytest.fixture
def computer(tmp_path):
    return Computer(tmp_path)


def states(run):
    return [(item["name"], item["state"], item["actions"]) for item in run.result()["units"]]


def test_units_come_and_change_and_go(computer):
    first = {CORE: text(1), SYNC: text(1, f"PartOf={CORE}")}
    planned = computer.run(first)
    assert planned.changed and computer.files() == {}
    assert mentions(planned.summary(check_mode=True), CORE, SYNC)
    made = computer.apply(first)
    assert states(made) == [(name, "started", ["write", "enable", "start"]) for name in (CORE, SYNC)]
    assert computer.running() == {CORE: (True, "1"), SYNC: (True, "1")} and computer.files() == first
    assert computer.record()["units"] == [CORE, SYNC] and computer.record()["pending"] == []
    assert made.difference[-1] == {
        "before_header": "the states of the units",
        "after_header": "the states of the units",
        "before": f"{CORE}: inactive, absent\n{SYNC}: inactive, absent\n",
        "after": f"{CORE}: active, enabled (start: it was inactive)\n{SYNC}: active, enabled (start: it was inactive)\n",
    }
    again = computer.apply(first)
    assert not again.changed and again.summary(check_mode=False) == "2 units were right."

    second = {SYNC: text(2)}
    changed = computer.apply(second)
    assert mentions(changed.summary(check_mode=False), CORE, SYNC)
    assert computer.running() == {SYNC: (True, "2")} and computer.files() == second
    computer.apply({})
    assert (computer.running(), computer.files(), computer.records.exists()) == ({}, {}, False)


def test_a_unit_that_does_not_start_brings_the_old_state_back(computer):
    first = {CORE: text(1), SYNC: text(1)}
    computer.apply(first)
    record = computer.record()
    run = computer.run({CORE: text(2), "new.service": text(2, "bad")})
    with pytest.raises(StepFailure) as caught:
        run.apply()
    assert mentions(str(caught.value), "new.service", "previous")
    assert run.failure(caught.value) == {"changed": False, "previous_state_is_back": True}
    assert (computer.running(), computer.files()) == ({CORE: (True, "1"), SYNC: (True, "1")}, first)
    # What was restarted on the way is restarted by the next run, too: code of other modules may be newer than it.
    assert computer.record() == {**record, "pending": [CORE, SYNC]}
    assert states(computer.apply(first)) == [
        (CORE, "restarted", ["reenable", "restart"]),
        (SYNC, "restarted", ["reenable", "restart"]),
    ]


def test_a_restored_file_counts_for_a_process_that_read_before(computer):
    units = {CORE: text(1), SYNC: text(1, "behind /etc/robots/sync.json")}
    computer.apply(units)
    run = computer.apply(units)
    assert states(run) == [(CORE, "unchanged", []), (SYNC, "restarted", ["restart"])]
    assert "(/etc/robots/sync.json was written after its start)" in run.summary(check_mode=False)
    assert not computer.run(units).changed


def test_a_former_unit_that_does_not_start_again_is_told(computer, monkeypatch):
    computer.apply({CORE: text(1)})
    bring = computer.systemd.bring

    def broken(verb, name):
        if name == CORE:
            raise Problem(f"The unit {CORE} did not {verb}.")
        bring(verb, name)

    monkeypatch.setattr(computer.systemd, "bring", broken)
    run = computer.run({CORE: text(2)})
    computer.systemd.call("stop", CORE)
    with pytest.raises(StepFailure) as caught:
        run.apply()
    assert mentions(str(caught.value), CORE, CORE)
    assert run.failure(caught.value) == {"changed": True, "previous_state_is_back": False}


def test_a_folder_that_cannot_be_removed_again_is_a_sentence(computer, monkeypatch):
    def refuse(_paths):
        raise OSError(errno.EROFS, os.strerror(errno.EROFS), "/var/lib/robot")

    monkeypatch.setattr(unit_steps.systemctl, "remove_trees", refuse)
    with pytest.raises(StepFailure) as caught:
        computer.apply({CORE: text(1, "bad")})
    assert mentions(str(caught.value), CORE, "/var/lib/robot")


def test_a_machine_without_systemd_or_folder_is_a_sentence(computer, monkeypatch):
    monkeypatch.setattr(computer.systemd, "unit_path", lambda: ["/a", "/b"])
    with pytest.raises(Problem, match="systemd.*/a.*/b"):
        computer.run({CORE: text(1)})
    monkeypatch.setattr(computer.systemd, "runs", lambda: False)
    with pytest.raises(Problem, match="systemd does not run on this computer"):
        computer.run({CORE: text(1)})
    assert not computer.run({}).changed


FIRST = {CORE: text(1), SYNC: text(1)}


@pytest.mark.slow
@pytest.mark.parametrize("wanted", [FIRST, {CORE: text(2), "new.service": text(2)}, {}])
@pytest.mark.parametrize("first", [{}, FIRST])
def test_kill_at_any_call_leaves_what_the_next_run_repairs(tmp_path, killed_at, first, wanted):
    killed, step = True, 0
    while killed:
        computer = Computer(tmp_path / str(step))
        computer.apply(first)
        killed = killed_at(step, computer.apply, wanted)
        computer.apply(wanted)
        assert computer.files() == wanted, step
        expected = {name: (True, read_inputs(content)) for name, content in wanted.items()}
        assert computer.running() == expected, step
        assert not computer.apply(wanted).changed, step
        computer.apply({})
        assert (computer.running(), computer.files(), computer.records.exists()) == ({}, {}, False), step
        step += 1
    assert step > 12 or first == wanted


def test_a_user_who_is_not_root_is_refused_in_check_mode_too(tmp_path, monkeypatch):
    computer = Computer(tmp_path)
    monkeypatch.setattr(os, "geteuid", lambda: 1000)
    assert computer.run({CORE: text("1")}).refusals == [
        "The user 1000 cannot change units of the system; expected root: run as root (become: true).",
        "Nothing was changed.",
    ]
    assert computer.run({}).refusals == []


def test_an_immutable_unit_file_is_refused_before_a_unit_stops(tmp_path):
    computer = Computer(tmp_path)
    computer.apply({CORE: text("1")})
    path = computer.systemd.folder / CORE
    if subprocess.run(["chattr", "+i", str(path)], capture_output=True, check=False).returncode:
        pytest.skip("no flags on this file system")
    try:
        for wanted in ({CORE: text("2")}, {}):
            assert f"run 'chattr -i {path}'" in computer.run(wanted).refusals[0]
    finally:
        subprocess.run(["chattr", "-i", str(path)], check=True)
    assert computer.running() == {CORE: (True, "1")}
