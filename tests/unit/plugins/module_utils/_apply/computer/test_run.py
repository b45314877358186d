# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Several concerns in one run: their order, their failures, and the confirmation of those that can cut the controller off."""

import itertools
import types

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.computer import run as computer
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.computer.concerns import (
    CONCERNS,
    select_concerns,
)
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.transaction import deadman
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.transaction.module import Concern, ModuleRun
from ansible_collections.rosfleet.multimaster.plugins.module_utils._base.difference import difference
from ansible_collections.rosfleet.multimaster.plugins.module_utils._base.problem import Problem
from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine import shells
from mentioned import mentions

OPTIONS = {"name": {"type": "str", "required": True}, "fails": {"type": "str", "default": ""}}
OPTIONS["records"] = {"type": "str", "default": "none"}  # no absolute path, so there is no lock


class Timer:
    """A timer that never rings."""

    def start(self, unit, seconds, argv):
        self.argv = argv

    def stop(self, unit):
        pass


class Change(ModuleRun):
    """Brings two files: what is at run time, and what a boot reads."""

    folder = None

    def __init__(self, options, memory=None):
        self.options, self.memory = options, memory or {"of": options["name"]}
        self.now, self.boot = (self.folder / f"{options['name']}-{kind}" for kind in ("now", "boot"))
        self._fail("plan")
        self.runtime_changes = not self.now.exists()
        self.changed = self.runtime_changes or not self.boot.exists()

    def _fail(self, when):
        if self.options["fails"] == when:
            raise Problem(f"{self.options['name']} fails.")

    def undo_steps(self):
        return [["rm", "-f", str(self.now)]]

    def apply_runtime(self):
        self.now.touch()
        self._fail("apply")

    def apply(self):
        self._fail("apply")
        self.now.touch()
        self.boot.touch()

    @property
    def difference(self):
        return [difference(self.options["name"], None, b"new")] if self.changed else []

    def result(self):
        return {"name": self.options["name"]}

    def summary(self, check_mode):
        return f"{self.options['name']} is there."


def concern(name, guarded=""):
    return Concern(name, OPTIONS, lambda module, memory: Change(module.params, memory), guarded)


SETTINGS, ROUTES, FILES = concern("sysctl", "kernel settings"), concern("routes", "routes"), concern("managed_files")


class Module:
    """An AnsibleModule that keeps its end."""

    _diff = True
    backup_local, params = None, {}

    def __init__(self, check_mode=False):
        self.check_mode, self.end, self.warned = check_mode, None, []

    def exit_json(self, **result):
        self.end = result

    def fail_json(self, **result):
        self.end = {"failed": True, **result}

    def warn(self, sentence):
        self.warned.append(sentence)


@pytest.fixture(autouse=True)
def _machine(tmp_path, monkeypatch):
    monkeypatch.setattr(deadman, "Timer", Timer)
    monkeypatch.setattr(deadman, "FOLDER", str(tmp_path / "run"))
    monkeypatch.setattr(deadman, "connection", lambda: "")
    monkeypatch.setattr(Change, "folder", tmp_path)


@pytest.fixture
def carry_out():
    """Run concerns; returns the result of the module."""

    def carry_out(*asked, check_mode=False, **how):
        module = Module(check_mode)
        computer.carry_out(module, asked, **how)
        return module.end

    return carry_out


def there(tmp_path):
    """The files that were brought, and the switches that wait."""
    return {path.name for path in tmp_path.iterdir() if path.name != "run"} | {
        path.name for path in (tmp_path / "run").glob("*")
    }


TRIED = [(SETTINGS, {"name": "a", "confirm_within": 60, "confirmation": "word"})]
TRIED += [(ROUTES, {"name": "b", "confirm_within": 60, "confirmation": "word"})]
CONFIRMING = [(one, {**options, "confirm_within": 0}) for one, options in TRIED]
REST = [(FILES, {"name": "c"}), (FILES, {"name": "d"})]


def test_all_is_done_in_order_where_nothing_is_to_be_confirmed(carry_out, tmp_path):
    result = carry_out((SETTINGS, {"name": "a"}), (ROUTES, {"name": "b"}), *REST)
    assert there(tmp_path) == {f"{name}-{kind}" for name in "abcd" for kind in ("now", "boot")}
    assert list(result["concerns"]) == ["sysctl", "routes", "managed_files"]
    assert [one["name"] for one in result["concerns"]["managed_files"]] == ["c", "d"]
    assert [entry["after_header"] for entry in result["diff"]] == list("abcd")
    assert (result["changed"], result["unconfirmed"]) == (True, False)
    assert result["msg"] == "a is there. b is there. c is there. d is there."
    assert carry_out((SETTINGS, {"name": "a"}), *REST)["changed"] is False


def test_risky_changes_are_tried_and_confirmed_together(carry_out, tmp_path):
    assert carry_out(*TRIED)["unconfirmed"] is True
    assert there(tmp_path) == {"a-now", "b-now", "rollback-sysctl", "rollback-routes"}
    result = carry_out(*CONFIRMING, *REST)
    assert (result["unconfirmed"], result["changed"]) == (False, True)
    assert there(tmp_path) == {f"{name}-{kind}" for name in "abcd" for kind in ("now", "boot")}


def test_a_change_that_waits_is_not_taken_back_while_a_slow_machine_goes_on(tmp_path, monkeypatch, carry_out):
    """The kernel settings took 20 s, so they wait for 100 s from the moment at which the routes begin."""
    clock, seen = itertools.count(0, 10), []
    monkeypatch.setattr(computer, "time", types.SimpleNamespace(monotonic=lambda: next(clock)))

    class Look(Change):
        def apply_runtime(self):
            seen.append(deadman.Switch("sysctl").state()["seconds"])
            super().apply_runtime()

    routes = ROUTES._replace(make=lambda module, memory: Look(module.params, memory))
    assert carry_out(TRIED[0], (routes, TRIED[1][1]))["unconfirmed"] is True
    assert seen == [100]


def test_a_waiting_change_leaves_the_rest_to_the_second_run(carry_out, tmp_path):
    result = carry_out(*TRIED, *REST)
    assert result["unconfirmed"] is True and "managed_files" not in result["concerns"]
    assert there(tmp_path) == {"a-now", "b-now", "rollback-sysctl", "rollback-routes"}
    carry_out(*CONFIRMING, *REST)
    again = carry_out(*TRIED, *REST)
    assert (again["unconfirmed"], again["changed"], list(again["concerns"])) == (
        False,
        False,
        ["sysctl", "routes", "managed_files"],
    )


def test_a_trial_that_fails_takes_the_one_before_it_back(carry_out, tmp_path):
    for when in ("plan", "apply"):
        result = carry_out(TRIED[0], (ROUTES, {**TRIED[1][1], "fails": when}))
        assert result["failed"] and result["msg"].startswith("b fails.")
        assert result["msg"].endswith("So the kernel settings were taken back, too.")
        assert there(tmp_path) == set()


@pytest.mark.parametrize("rung", [("sysctl",), ("sysctl", "routes")])
def test_a_rollback_by_the_machine_takes_the_others_along(carry_out, tmp_path, rung):
    carry_out(*TRIED)
    for name in rung:
        deadman.Switch(name).roll_back_now()
    result = carry_out(*CONFIRMING, *REST)
    assert result["failed"] and result["rolled_back"] is True
    assert mentions(result["msg"], "60", "confirmed")
    assert result["msg"].endswith("So the routes were taken back, too.")
    assert there(tmp_path) == set()


def test_what_is_confirmed_stays_where_a_later_one_fails(carry_out, tmp_path):
    carry_out(*TRIED)
    deadman.Switch("routes").roll_back_now()
    result = carry_out(*CONFIRMING, *REST)
    assert "The routes were not confirmed" in result["msg"] and "kernel settings" not in result["msg"]
    assert there(tmp_path) == {"a-now", "a-boot"}


def test_what_shells_see_is_read_after_files_were_written(carry_out, monkeypatch):
    monkeypatch.setattr(shells, "probe", lambda: {"login": {}})
    assert carry_out(REST[0], read_back=True, check_mode=True).get("shells") is None
    assert carry_out(REST[0], (FILES, {"name": "x", "fails": "plan"}), read_back=True).get("shells") is None
    assert carry_out(REST[1], read_back=True)["shells"] == {"login": {}}
    assert "shells" not in carry_out(REST[1], read_back=True), "nothing was written"


def test_a_shell_that_cannot_be_asked_is_no_failure(carry_out, monkeypatch):
    monkeypatch.setattr(shells, "probe", lambda: 1 / 0)
    assert carry_out(REST[0], read_back=True)["shells"] == {"login": None, "ssh": None, "desktop": None}


def test_a_failure_ends_the_run(carry_out, tmp_path):
    result = carry_out(REST[0], (FILES, {"name": "x", "fails": "apply"}), REST[1])
    assert (result["failed"], result["msg"], result["changed"]) == (True, "x fails.", True)
    assert there(tmp_path) == {"c-now", "c-boot"}


def test_the_connection_from_before_confirms_nothing(carry_out, tmp_path, monkeypatch):
    monkeypatch.setattr(deadman, "connection", lambda: "1-2")
    carry_out(*TRIED)
    before = there(tmp_path)
    result = carry_out(*CONFIRMING, *REST)
    assert (result["unconfirmed"], result["same_connection"], result["changed"]) == (True, True, False)
    assert there(tmp_path) == before


def test_wrong_options_of_one_concern_keep_all_from_beginning(carry_out, tmp_path):
    result = carry_out(REST[0], (FILES, {"fail": "x"}))
    assert result["failed"] and result["msg"].startswith("managed_files: ")
    assert result["msg"].endswith(" Nothing was changed.")
    assert there(tmp_path) == set()


def test_check_mode_shows_all_and_does_nothing(carry_out, tmp_path):
    result = carry_out((SETTINGS, {"name": "a"}), (ROUTES, {"name": "b"}), *REST, check_mode=True)
    assert result["changed"] and len(result["diff"]) == 4 and there(tmp_path) == set()


def test_the_modules_themselves(carry_out, tmp_path):
    """Their own code by their own options, from the table."""
    hosts = tmp_path / "hosts"
    hosts.write_text("127.0.0.1 localhost\n", encoding="utf-8")
    records = str(tmp_path / "records")
    given = dict.fromkeys((one.name for one in CONCERNS), None)
    given["hosts_entries"] = {
        "entries": [{"address": "192.168.1.229", "names": ["kobuki1computer"]}],
        "path": str(hosts),
        "records": records,
    }
    given["managed_files"] = [
        {"bundle": "x", "files": [{"path": str(tmp_path / "names"), "content": "y\n"}], "records": records}
    ]
    result = carry_out(*select_concerns(given))
    assert result["changed"] and "kobuki1computer" in hosts.read_text(encoding="utf-8")
    assert (tmp_path / "names").read_text(encoding="utf-8") == "y\n"
    assert carry_out(*select_concerns(given))["changed"] is False
