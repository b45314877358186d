# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The words for people in the table of docs/operate/variables.md, which `make references` writes, fit the variables that are read."""

import pathlib

import pytest
import yaml
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._inventory import kinds, variables

from tools import references

PAGE = pathlib.Path(__file__).resolve().parents[5] / "docs/operate/variables.md"


def _read_table():
    """The cells of each row of the table: name, scope, value, default, meaning, example."""
    lines = PAGE.read_text(encoding="utf-8").partition(
        "| variable | set for | value | default | meaning | example |\n"
    )[2]
    return list(map(references.split_row, lines.partition("\n\n")[0].splitlines()[1:]))


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


@pytest.mark.parametrize("cells", TABLE, ids=[cells[0] for cells in TABLE])
def test_a_row_says_what_a_variable_is_for(cells):
    variable = variables.BY_NAME[cells[0].strip("`")]
    assert len(cells) == 6 and cells[4].endswith(".") and len(cells[4]) > 20
    variable.read(yaml.safe_load(cells[5].strip("`")))  # the example
    assert (cells[3] == "required") == bool(variable.example)
    assert not variable.example or cells[5] == f"`{variable.example}`"


@pytest.mark.parametrize("name", CHOICES)
def test_the_choices_of_a_variable_are_in_its_row(name):
    row = next(cells for cells in TABLE if cells[0] == f"`{name}`")
    assert len(CHOICES[name]) > 1 and row[2] == ", ".join(f"`{choice}`" for choice in CHOICES[name])


def test_the_variables_with_choices_are_found():
    assert len(CHOICES) >= 12
