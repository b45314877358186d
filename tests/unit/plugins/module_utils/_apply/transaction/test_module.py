# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The shell of the modules that change a machine, with a module and a run that write down what happens."""

import errno

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.transaction import module as shell
from ansible_collections.rosfleet.multimaster.plugins.module_utils._base.problem import Problem
from mentioned import mentions


class End(Exception):
    """The end of the module, with its return values."""


class Module:
    """An AnsibleModule as far as the shell needs it."""

    _name = "example"
    params = {"records": "none"}  # no absolute path, so there is no lock: test_lock.py has it

    def __init__(self, check_mode=False, diff=False):
        self.check_mode, self._diff = check_mode, diff
        self.warned = []

    def warn(self, sentence):
        self.warned.append(sentence)

    def exit_json(self, **result):
        raise End({"failed": False, **result})

    def fail_json(self, **result):
        raise End({"failed": True, **result})


class Run(shell.ModuleRun):
    changed = True

    def __init__(self, refusals=(), problem=None):
        self.applied = False
        self.refused, self.problem = list(refusals), problem

    refusals = property(lambda self: self.refused)
    warnings = property(lambda self: ["first"] + (["second"] if self.applied else []))
    difference = property(lambda self: [{"before": "a", "after": "b"}])

    def result(self):
        return {"applied": self.applied}

    def failure(self, problem):
        return {"said": str(problem)}

    def summary(self, check_mode):
        return "would be" if check_mode else "was"

    def apply(self):
        if self.problem:
            raise self.problem
        self.applied = True


@pytest.fixture
def end(monkeypatch):
    """Run the shell with a module; returns its end."""

    def end(module, make):
        monkeypatch.setattr(shell, "Module", lambda **arguments: module)
        with pytest.raises(End) as caught:
            shell.run_module(shell.Concern("example", {}, lambda given, memory: make(memory)))
        return caught.value.args[0]

    return end


def test_plan_warn_apply_and_report(end):
    module = Module(diff=True)
    assert end(module, lambda memory: Run()) == {
        "failed": False,
        "changed": True,
        "applied": True,
        "msg": "was",
        "diff": [{"before": "a", "after": "b"}],
    }
    assert module.warned == ["first", "second"]


def test_check_mode_is_the_plan_alone(end):
    module = Module(check_mode=True)
    assert end(module, lambda memory: Run()) == {"failed": False, "changed": True, "applied": False, "msg": "would be"}
    assert module.warned == ["first"]


@pytest.mark.parametrize("check_mode", [False, True])
def test_a_refusal_ends_the_module_before_any_change(end, check_mode):
    module, run = Module(check_mode), Run(["No.", "Never."])
    assert end(module, lambda memory: run) == {"failed": True, "msg": "No. Never.", "said": "No. Never."}
    assert not run.applied and module.warned == []


def test_a_failure_has_the_fields_of_the_run(end):
    module = Module()
    assert end(module, lambda memory: Run(problem=Problem("Full."))) == {
        "failed": True,
        "msg": "Full.",
        "said": "Full.",
    }
    assert module.warned == ["first"]


def test_a_run_that_cannot_be_made_is_a_sentence(end):
    def make(memory):
        raise Problem("Wrong option.")

    assert end(Module(), make) == {"failed": True, "msg": "Wrong option."}


def test_a_file_that_a_run_cannot_read_is_a_sentence(end):
    def make(memory):
        raise IsADirectoryError(errno.EISDIR, "Is a directory", "/etc/x")

    result = end(Module(), make)
    assert result["failed"] and mentions(result["msg"], "/etc/x", "Is a directory", "Nothing was changed")


class Guard(shell.PlainGuard):
    """Stands for deadman.DeadmanGuard."""

    def begin(self):
        return "memory"

    def apply(self, run):
        run.applied = "guarded"

    def failure(self, problem, **result):
        return dict(result, failed=True, msg=f"{problem} Rolled back.")


def test_a_guard_is_asked_at_every_end():
    module, memories = Module(), []

    def make(module, memory):
        memories.append(memory)
        return Run()

    assert shell.run_locked(module, make, Guard(), [])["applied"] == "guarded"
    assert memories == ["memory"]
    refused = shell.run_locked(module, lambda module, memory: Run(["No."]), Guard(), [])
    assert refused["msg"] == "No. Rolled back."


def test_a_module_with_a_switch_has_its_options(monkeypatch):
    class Stop(Exception):
        """Instead of the module."""

    def stop(**arguments):
        raise Stop(sorted(arguments["argument_spec"]))

    monkeypatch.setattr(shell, "Module", stop)
    for guarded, options in (("routes", ["confirm_within", "confirmation", "own"]), ("", ["own"])):
        with pytest.raises(Stop) as caught:
            shell.run_module(shell.Concern("routes", {"own": {}}, lambda module, memory: Run(), guarded))
        assert caught.value.args[0] == options


class ReadOnlyGuard(Guard):
    """A guard that cannot take an earlier change back."""

    calls = 0

    def begin(self):
        self.calls += 1
        raise OSError(errno.EROFS, "Read-only file system", "/run/x")


@pytest.mark.parametrize("check_mode", [False, True])
def test_a_way_back_that_cannot_be_written_is_a_sentence(check_mode):
    guard = ReadOnlyGuard()
    result = shell.run_locked(Module(check_mode), lambda module, memory: Run(), guard, [])
    assert result["msg"].startswith("/run/x cannot be written (Read-only file system); ")
    assert "Nothing was changed" not in result["msg"] and guard.calls == 1
