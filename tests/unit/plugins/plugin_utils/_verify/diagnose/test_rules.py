# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The table of decision rules leads to the files that decide."""

import pathlib

from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.diagnose.rules import RULES

ROOM = pathlib.Path(__file__).resolve().parents[6] / "plugins/plugin_utils/_verify"


def test_each_rule_names_the_files_that_decide():
    """The judge of the check decides by a value alone; all else is decided elsewhere, and the file is there."""
    assert [rule.id for rule in RULES if not rule.decides] == ["value"]
    for rule in RULES:
        assert all((ROOM / file).is_file() for file in rule.decides), rule.id
