# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The file in which a problem of an inventory is corrected."""

import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._inventory.places import HostMembership, name_files

MEMBERS = {
    f"kobuki{number}-pc": HostMembership(f"kobuki{number}", ("all", "kobukis", "robots")) for number in range(1, 6)
}
FILES = {
    "kobukis": {"group_vars/kobukis.yml": "---\nmultimaster_exports:\n  - {topics: [/scan]}\n"},
    "kobuki5": {"group_vars/kobuki5/own.yml": '"multimaster_exports": []\n'},
    "robots": {"group_vars/robots.yml": "multimaster_common_network: 192.168.1.0/24\n# multimaster_exports: no\n"},
}


def problem(number, end="correct it in the inventory."):
    return f"kobuki{number}-pc: multimaster_exports is /kobuki{number}/; expected kobuki{number}/: {end}"


@pytest.mark.parametrize("end", ["correct it in the inventory.", "correct 'frames' in group_vars/kobuki1.yml."])
def test_the_file_that_has_the_variable_is_named(end):
    (text,) = name_files([problem(1, end)], MEMBERS, FILES)
    assert text.endswith(" in group_vars/kobukis.yml.")


def test_one_error_of_several_robots_is_told_once():
    first, other = name_files(
        [*map(problem, range(1, 5)), "kobuki1-pc: multimaster_address is x; expected y."], MEMBERS, FILES
    )
    assert first.startswith("kobuki1-pc: ") and first.endswith(
        " The same holds for kobuki2-pc, kobuki3-pc, kobuki4-pc."
    )
    assert other == "kobuki1-pc: multimaster_address is x; expected y."


def test_where_two_files_set_it_or_none_the_sentence_stays():
    assert name_files([problem(5)], MEMBERS, FILES) == [problem(5)]
    assert name_files([problem(1)], MEMBERS, {}) == [problem(1)]
    strange = ["a text without a host", "nobody: multimaster_exports is x: correct it in the inventory."]
    assert name_files(strange, MEMBERS, FILES) == strange
