# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The key of a computer in the tunnel: made once, closed to others, and told in its public half alone."""

import os

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._base.commands import Answer
from ansible_collections.rosfleet.multimaster.plugins.module_utils._base.problem import Problem
from ansible_collections.rosfleet.multimaster.plugins.module_utils._features.tunnel import key


class Wg:
    """wg(8): private keys are numbers, and public ones say whose they are."""

    def __init__(self, folder, monkeypatch):
        self.made, self.broken, self.path = 0, "", folder / "wireguard" / "x.key"
        monkeypatch.setattr(key.commands, "run", self.run)

    def run(self, argv, given=b""):
        if self.broken == argv[1]:
            return Answer(1, b"", "no such thing")
        if argv[1] == "genkey":
            self.made += 1
            return Answer(0, f"private{self.made}\n".encode(), "")
        return Answer(0, b"public of " + given, "")

    def bring(self, **options):
        made = key.TunnelKey({"rotate": False, "path": str(self.path), **options})
        made.apply()
        return made

    @property
    def next(self):
        return self.path.with_name(self.path.name + key.NEXT)

    def take_into_use(self):
        self.next.rename(self.path)


@pytest.fixture(name="wg")
def fixture_wg(tmp_path, monkeypatch):
    return Wg(tmp_path, monkeypatch)


def test_a_key_is_made_once_and_closed_to_others(wg):
    first = wg.bring()
    assert first.changed and first.result() == {"public_key": "public of private1", "waiting_key": ""}
    assert wg.next.stat().st_mode & 0o777 == 0o600 and wg.path.parent.stat().st_mode & 0o777 == 0o700
    for _time in range(2):
        again = wg.bring()
        assert not again.changed and again.result() == first.result() and wg.made == 1
        assert "private" not in first.summary(False) + again.summary(True)
        if wg.next.exists():
            wg.take_into_use()


def test_a_key_without_its_public_half_is_not_written(wg):
    wg.broken = "pubkey"
    with pytest.raises(Problem, match="wg pubkey failed"):
        wg.bring()
    assert wg.made == 1 and not wg.path.parent.exists()


def test_a_plan_alone_makes_no_key(wg):
    planned = key.TunnelKey({"rotate": False, "path": str(wg.path)})
    assert planned.changed and not wg.path.parent.exists() and not wg.made
    assert planned.result() == {"public_key": "", "waiting_key": ""}


@pytest.mark.root
def test_a_place_that_takes_no_key_is_told_before_one_is_made(wg):
    assert key.TunnelKey({"rotate": False, "path": str(wg.path)}).refusals == []
    planned = key.TunnelKey({"rotate": False, "path": "/proc/sys/net/x.key"})
    assert len(planned.refusals) == 1 and "is no place for files" in planned.refusals[0]


def test_a_rotation_leaves_the_key_that_is_in_use(wg):
    wg.bring()
    wg.take_into_use()
    assert wg.bring(rotate=True).result() == {"public_key": "public of private2", "waiting_key": ""}
    assert wg.path.read_text() == "private1\n"
    broken_off = wg.bring()
    assert not broken_off.changed
    assert broken_off.result() == {"public_key": "public of private1", "waiting_key": "public of private2"}


def test_a_damaged_key_can_be_rotated(wg):
    wg.bring()
    wg.take_into_use()
    wg.path.write_text("")
    wg.path.chmod(0o600)
    wg.broken = ""
    assert wg.bring(rotate=True).result()["public_key"] == "public of private2"


def test_before_wg_is_installed_a_plan_knows_no_key(wg, monkeypatch):
    wg.bring()
    monkeypatch.setattr(key.shutil, "which", lambda program: None)
    wg.broken = "pubkey"
    planned = key.TunnelKey({"rotate": False, "path": str(wg.path)}, check_mode=True)
    assert not planned.changed and planned.result()["public_key"] == ""


def test_all_files_with_a_key_are_listed(wg):
    wg.bring()
    wg.bring(rotate=True)
    left = wg.path.with_name(wg.path.name + ".rosfleet-new-7")
    left.write_text("private8\n")
    wg.path.symlink_to("nowhere")
    assert sorted(key.list_keys(str(wg.path))) == sorted(map(str, (wg.path, wg.next, left)))


@pytest.mark.parametrize("make", ["open", "link", "folder"])
def test_a_key_that_others_may_know_is_refused(wg, make):
    wg.path.parent.mkdir()
    if make == "link":
        (wg.path.parent / "other").write_text("private9\n")
        wg.path.symlink_to(wg.path.parent / "other")
    elif make == "folder":
        wg.path.mkdir()
    else:
        wg.path.write_text("private9\n")
        os.chmod(wg.path, 0o640)
    with pytest.raises(Problem, match="another user may know it"):
        wg.bring()
    assert not wg.made


@pytest.mark.parametrize("word", ["genkey", "pubkey"])
def test_a_wg_that_fails_is_a_sentence(wg, word):
    wg.broken = word
    with pytest.raises(Problem, match=f"wg {word} failed.*install it"):
        wg.bring()
