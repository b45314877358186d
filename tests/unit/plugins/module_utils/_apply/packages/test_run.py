# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Packages: what was there stays, what the collection has installed is recorded before, and removed when it is wanted no more."""

import itertools
import random

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.packages import run
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.transaction import atomic, record
from ansible_collections.rosfleet.multimaster.plugins.module_utils._base.commands import Answer
from ansible_collections.rosfleet.multimaster.plugins.module_utils._base.problem import Problem
from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine import fkie
from mentioned import mentions

REPLACES = {"chrony": "systemd-timesyncd"}  # Debian has one time service at a time
NAMES = ["ros-a", "ros-b", "ros-c", "ros-d"]


class Apt:
    """The packages of a computer, behind the commands that are run there."""

    def __init__(self, folder, monkeypatch):
        self.installed, self.ran, self.broken = set(), [], ()
        self.record, self.records = folder / "packages", folder / "records"
        monkeypatch.setattr(fkie, "INSTALLED", str(self.record))
        monkeypatch.setattr(fkie, "run", self.policy)
        monkeypatch.setattr(run.commands, "run", self.apt_get)

    def policy(self, argv, **_options):
        lines = [f"{name}:\n  Installed: {1 if name in self.installed else '(none)'}" for name in argv[2:]]
        return Answer(0, "\n".join(lines).encode(), "")

    def apt_get(self, argv, **_options):
        words = [word for word in argv[1:] if not word.startswith("--")]
        if "--simulate" in argv:
            gone = sorted({REPLACES[name] for name in words[1:] if name in REPLACES} & self.installed)
            return Answer(0, "".join(f"Remv {name} [1]\nInst {words[1]} (1)\n" for name in gone).encode(), "")
        self.ran.append((words, self.record.read_text() if self.record.exists() else ""))
        for name in words[1:]:
            if name in self.broken:
                return Answer(100, b"", f"W: slow\nE: Unable to locate package {name}")
            added = words[0] == "install" and not name.endswith("-")
            (self.installed.add if added else self.installed.discard)(name.rstrip("-"))
            self.installed.discard(REPLACES.get(name, ""))
        return Answer(0, b"", "")

    def bring(self, *names, keep=False):
        packages = run.Packages({"names": list(names), "keep": keep, "records": str(self.records)})
        assert not packages.refusals
        packages.apply()
        return packages


@pytest.fixture(name="apt")
def fixture_apt(tmp_path, monkeypatch):
    return Apt(tmp_path, monkeypatch)


def test_what_is_missing_is_recorded_and_installed(apt):
    apt.installed.add("ros-a")
    found = apt.bring("ros-a", "ros-b")
    assert (found.changed, found.result()) == (True, {"installed": ["ros-b"], "removed": []})
    ((words, record),) = apt.ran
    assert words == ["install", "ros-b"] and "ros-b" in record and "ros-a" not in record
    again = apt.bring("ros-a", "ros-b")
    assert not again.changed and len(apt.ran) == 1
    assert again.summary(False) == "The packages were right."


def test_what_a_package_replaces_comes_back_with_its_removal(apt):
    apt.installed.add("systemd-timesyncd")
    assert apt.bring("ros-a", "chrony").summary(False) == "2 packages were installed, 0 removed."
    assert apt.installed == {"ros-a", "chrony"}
    assert "# chrony replaced systemd-timesyncd\n" in apt.record.read_text()
    assert not apt.bring("ros-a", "chrony").changed  # the record is read again
    found = apt.bring("ros-a")
    assert mentions(found.summary(False), "0", "1")
    assert apt.installed == {"ros-a", "systemd-timesyncd"} and "replaced" not in apt.record.read_text()


def test_where_apt_does_not_answer_nothing_is_forgotten(apt, monkeypatch):
    """Neither the installed packages are known then, nor those that a package replaces."""
    apt.installed.update(("ros-a", "systemd-timesyncd"))
    apt.bring("ros-b")
    late = Answer(-1, b"", "apt gave no answer within 60 s")
    for module, name, words in (
        (fkie, "run", "not known which packages are installed"),
        (run.commands, "run", "which packages the new ones replace"),
    ):
        with monkeypatch.context() as patch:
            patch.setattr(module, name, lambda *_words, **_more: late)
            with pytest.raises(Problem, match=words):
                apt.bring("ros-a", "chrony")
    with monkeypatch.context() as patch:
        patch.setattr(fkie, "INSTALLED", str(apt.records))  # a folder, so its text cannot be read
        with pytest.raises(OSError, match="Is a directory"):
            apt.bring()
    assert apt.installed == {"ros-a", "ros-b", "systemd-timesyncd"}
    apt.bring()
    assert apt.installed == {"ros-a", "systemd-timesyncd"}


def test_a_record_that_fails_at_the_end_puts_no_package_back(apt, monkeypatch):
    apt.bring("ros-a")

    def full(path):
        raise OSError(28, "No space left on device", path)

    monkeypatch.setattr(atomic, "sync_folder", full)
    with pytest.raises(Problem, match=r"\(No space left .* The packages are as planned: run the play again\.$"):
        apt.bring()
    monkeypatch.undo()
    assert apt.installed == set()


def test_what_is_wanted_no_more_goes_when_nothing_needs_it(apt):
    apt.installed.add("ros-a")
    apt.bring("ros-a", "ros-b")
    assert not apt.bring(keep=True).changed
    assert apt.bring().result() == {"installed": [], "removed": ["ros-b"]}
    assert apt.installed == {"ros-a"} and not apt.record.exists()


@pytest.mark.parametrize(
    ("before", "wanted", "times"),
    [((), (), 1), (("ros-a",), ("ros-a",), 1), ((), ("ros-a",), 1), (("ros-a",), (), 1), (("ros-a",), ("ros-b",), 3)],
    ids=["nothing", "as before", "one comes", "one goes", "one for the other"],
)
def test_the_record_is_read_once_unless_it_changes_meanwhile(apt, monkeypatch, before, wanted, times):
    apt.bring(*before)
    read, loads = record.Record.load, []
    monkeypatch.setattr(record.Record, "load", lambda self: loads.append(self.path) or read(self))
    apt.bring(*wanted)
    assert len(loads) == times
    assert apt.installed == set(wanted) and apt.record.exists() is bool(wanted)


def test_a_failure_says_what_apt_said_and_the_next_run_goes_on(apt):
    apt.broken = ("ros-b",)
    with pytest.raises(Problem, match='apt-get install .* failed \\("E: Unable to locate package ros-b"\\); expected'):
        apt.bring("ros-a", "ros-b")
    assert apt.installed == {"ros-a"} and "ros-a\nros-b\n" in apt.record.read_text()
    apt.broken = ()
    apt.bring("ros-a", "ros-b")
    assert apt.installed == {"ros-a", "ros-b"}
    apt.bring()
    assert not apt.installed and not apt.record.exists()


@pytest.mark.parametrize("name", ["", "-y", "ros a", "ros;x", "Ros", "../x", "ros\nx"])
def test_what_is_no_name_of_a_package_is_said(apt, name):
    with pytest.raises(Problem, match="The option names has .*; expected the name of a Debian package"):
        apt.bring(name)
    assert not apt.ran


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(40))
def test_what_others_have_installed_is_never_removed(apt, seed):
    """Plans, packages of others and failures by chance: at the end all is as the owner has left it."""
    drawn = random.Random(seed)
    foreign = set(drawn.sample(NAMES, drawn.randrange(3)))
    apt.installed |= foreign
    for _step in range(8):
        apt.broken = tuple(drawn.sample(NAMES, drawn.randrange(2)))
        try:
            apt.bring(*drawn.sample(NAMES, drawn.randrange(4)), keep=drawn.random() < 0.3)
        except Problem:
            pass
        assert foreign <= apt.installed
    apt.broken = ()
    apt.bring()
    assert apt.installed == foreign and not apt.record.exists()


def test_the_kinds_of_a_plan():
    for wanted, installed, ours in itertools.product([["a"], []], [{"a"}, set()], [["a"], []]):
        found = run.changes(wanted, installed, ours, keep=False)
        assert (found.new == ["a"]) is bool(wanted and not installed)
        assert (found.leftover == ["a"]) is bool(ours and not wanted)
        assert (found.intent == ["a"]) is bool(ours or (wanted and not installed))
        assert (found.after == ["a"]) is bool(wanted and (ours or not installed))
