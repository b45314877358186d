# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The table of docs/operate/variables.md, which people write and read, is about the variables that are read."""

import pathlib

import pytest
import yaml
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._inventory import exports, kinds, variables

PAGE = pathlib.Path(__file__).resolve().parents[5] / "docs/operate/variables.md"
SCOPES = {"computer": variables.OF_COMPUTER, "fleet": variables.OF_FLEET, "robot": variables.OF_ROBOT}


def _read_table():
    """The cells of each row of the table: name, scope, default, meaning, example."""
    lines = PAGE.read_text(encoding="utf-8").partition("| variable | set for | default | meaning | example |\n")[2]
    return [[cell.strip() for cell in line.strip("|").split(" | ")] for line in lines.splitlines()[1:]]


TABLE = _read_table()


def _list_choices(variable):
    """The words of a choice, as the sentence on another word lists them; nothing for a variable of another kind."""
    try:
        variable.read("none of them")
    except kinds.UnexpectedValue as expected:
        words = str(expected)
        return words.removeprefix("one of ").split(", ") if words.startswith("one of ") else []
    return []


CHOICES = {row.name: _list_choices(row) for row in variables.VARIABLES if _list_choices(row)}


def _yaml(value):
    return f"`{str(value).lower() if isinstance(value, bool) else value}`"


def test_the_table_has_each_variable_with_its_default():
    expected = [
        [f"`{row.name}`", scope, "" if row.default is None else _yaml(row.default)]
        for row in variables.VARIABLES
        for scope, rows in SCOPES.items()
        if row in rows
    ]
    assert [cells[:3] for cells in TABLE] == expected and len(TABLE) > 40


@pytest.mark.parametrize("cells", TABLE, ids=[cells[0] for cells in TABLE])
def test_a_row_says_what_a_variable_is_for(cells):
    variable = variables.BY_NAME[cells[0].strip("`")]
    assert len(cells) == 5 and cells[3].endswith(".") and len(cells[3]) > 20
    variable.read(yaml.safe_load(cells[4].strip("`")))  # the example
    assert cells[3].startswith("Required.") == bool(variable.example)
    assert not variable.example or cells[4] == f"`{variable.example}`"


@pytest.mark.parametrize("name", CHOICES)
def test_the_choices_of_a_variable_are_in_its_row(name):
    row = next(cells for cells in TABLE if cells[0] == f"`{name}`")
    assert len(CHOICES[name]) > 1 and all(f"`{choice}`" in f"{row[2]} {row[3]}" for choice in CHOICES[name])


def test_the_variables_with_choices_are_found():
    assert len(CHOICES) >= 12


def test_the_row_of_the_filters_has_all_of_them():
    meaning = next(cells[3] for cells in TABLE if cells[0] == "`multimaster_filters`")
    assert ", ".join(f"`{name}`" for name in sorted(exports.FILTERS)) in meaning
