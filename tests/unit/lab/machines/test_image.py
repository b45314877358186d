# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The names of the images: an image has another name when it, or the one below it, is built in another way."""

import pytest
from machines import image
from machines.podman import LabError

ALL = [image.Image(suite, full) for suite in image.RELEASES for full in (False, True)]


def names():
    return {(one.suite, one.full): one.name for one in ALL}


def test_each_image_has_a_name_of_its_own():
    assert len(set(names().values())) == len(ALL) == 6


@pytest.mark.parametrize(
    "table, changed",
    [("ROBOT", {False, True}), ("FULL", {True}), ("ROBOT_HOOKS", {False, True}), ("FULL_HOOKS", {True})],
)
def test_a_change_gives_new_names_to_an_image_and_the_one_above(monkeypatch, table, changed):
    before = names()
    monkeypatch.setattr(image, table, [*getattr(image, table), "more"])
    after = names()
    assert {key[1] for key in before if before[key] != after[key]} == changed


def test_no_package_is_in_both_lists():
    assert not set(image.ROBOT) & set(image.FULL)
    assert {name for release in image.RELEASES.values() for name in release.without} <= {*image.ROBOT, *image.FULL}


def test_an_unknown_release_is_refused():
    with pytest.raises(LabError, match="bullseye.*bookworm.*trixie"):
        image.Image("buster", full=False).recipe()
