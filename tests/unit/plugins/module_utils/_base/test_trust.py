# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Ownership decides: real folders of several users."""

import os
import pwd
import time

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._base import trust
from mentioned import mentions

NOBODY = pwd.getpwnam("nobody")
as_root = pytest.mark.skipif(os.geteuid() != 0, reason="only root can give a file to somebody else")


def words(path):
    return [doubt.words for doubt in trust.TrustCheck().doubts(str(path))]


@as_root
def test_what_root_alone_can_change_raises_no_doubt(tree):
    assert words(tree / "ws/devel/setup.sh") == []
    assert words(tree / "ws/missing/entry") == []
    assert words("/usr/bin") == words("/") == []


@as_root
@pytest.mark.parametrize("part", ["", "ws", "ws/devel", "ws/devel/setup.sh"])
def test_each_folder_on_the_way_counts(tree, part):
    os.chown(tree / part, NOBODY.pw_uid, NOBODY.pw_gid)
    assert words(tree / "ws/devel/setup.sh") == [f"{tree / part} belongs to nobody".replace("/ ", " ")]


@as_root
def test_what_is_not_there_is_in_the_hands_of_its_folder(tree):
    (tree / "ws").chmod(0o1777)
    assert words(tree / "ws/missing/entry") == [f"{tree}/ws can be written by everybody"]
    assert words("/tmp/nobody-has-this/x") == ["/tmp can be written by everybody"]
    assert words(tree / "ws/devel") == []  # the sticky bit: nobody can replace it


@as_root
def test_group_write_counts_when_the_group_has_members(tree):
    (tree / "ws").chmod(0o775)
    assert words(tree / "ws/devel") == []  # root's own group
    os.chown(tree / "ws", 0, NOBODY.pw_gid)
    assert words(tree / "ws/devel") == [f"{tree}/ws can be written by a group"]


@as_root
def test_links_are_followed(tree):
    (tree / "theirs").mkdir()
    os.chown(tree / "theirs", NOBODY.pw_uid, NOBODY.pw_gid)
    (tree / "link").symlink_to("theirs/x")
    (tree / "around").symlink_to("around")
    assert words(tree / "link/setup.sh") == [f"{tree}/theirs belongs to nobody"]
    assert words(tree / "ws/../theirs") == [f"{tree}/theirs belongs to nobody"]
    assert words(tree / "around/x") == []  # root's own loop leads nowhere


@as_root
def test_a_look_has_a_limit_of_parts(tree):
    look = trust.TrustCheck(most=100)
    found = [doubt for number in range(200) for doubt in look.doubts(f"{tree}/{number}/x")]
    assert {doubt.who for doubt in found} == {trust.EVERYBODY}
    assert mentions(found[0].words, "100", "paths")


@as_root
def test_a_look_ends_at_the_limit_of_parts():
    look = trust.TrustCheck(3)
    assert [doubt.words for doubt in look.doubts("/tmp")] == ["/tmp can be written by everybody"]
    assert [doubt.words for doubt in look.doubts("/tmp/x/y")] == [
        "its paths have more than 3 parts, so it is not known who can change them"
    ]


@as_root
def test_a_look_has_a_limit_of_time(tree):
    """A chain of links, each with 2,000 parts, again and again."""
    for number in range(40):
        (tree / f"l{number}").symlink_to("./" * 1900 + f"l{number + 1}")
    look = trust.TrustCheck(limit=0.5)
    began = time.monotonic()
    found = [doubt for _time in range(1000) for doubt in look.doubts(f"{tree}/l0/x")]
    assert time.monotonic() - began < 5
    assert set(found) == {
        trust.Doubt(
            trust.EVERYBODY, "a look at its paths takes more than 0.5 s, so it is not known who can change them"
        )
    }
