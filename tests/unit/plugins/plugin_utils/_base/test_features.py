# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The table of optional features, and the files that it names."""

import pathlib

import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._base.features import (
    FEATURES,
    FeaturePart,
    load_hooks,
)

FOLDER = pathlib.Path(__file__).parents[5] / "plugins/plugin_utils/_features"


@pytest.mark.parametrize("feature", FEATURES, ids=lambda feature: feature.name)
def test_each_file_with_hooks_is_in_the_row(feature):
    files = [path.stem for path in (FOLDER / feature.name).glob("*.py") if "\nHOOKS = " in path.read_text()]
    assert sorted(files) == sorted(feature.hooks)
    assert all(feature.name in load_hooks(file, object) for file in feature.hooks)


def test_each_folder_has_a_row():
    assert {path.name for path in FOLDER.iterdir() if (path / "__init__.py").exists()} == {
        feature.name for feature in FEATURES if not feature.rooms
    }


def test_hooks_of_another_kind_are_an_error():
    with pytest.raises(TypeError, match="HOOKS of clock/plan.py is no str"):
        load_hooks("plan", str)


def test_a_whole_without_the_part_has_none():
    class Whole:
        features = {}

    assert FeaturePart.find(Whole()) is None
    with pytest.raises(LookupError):
        FeaturePart.read(Whole())
