# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The page of the checks has all of them, in their order."""

import re
from pathlib import Path

import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.checks.engine import (
    COMPUTER,
    ITSELF_TOO,
    MASTER,
    MASTER_TOO,
    MEMBER,
    ROSCORES,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.checks.table import CHECKS

PAGE = Path(__file__).resolve().parents[6] / "docs/operate/checks.md"
ROW = re.compile(r"\| `(\w+)` \| ([^|]+) \| ([^|]+) \| ([^|]*)\|")


def read_rows():
    """Read the rows of the table of checks: name, for whom, what is expected, where the report has it."""
    _before, head, table = PAGE.read_text().partition("| check | for | expected | report |\n|---|---|---|---|\n")
    assert head
    lines = table.partition("\n\n")[0].splitlines()
    return [ROW.fullmatch(line).groups() for line in lines]


def test_the_page_has_each_check_in_its_order():
    assert [name for name, *_words in read_rows()] == [check.id for check in CHECKS]


#: scope of a check -> how its words on the page begin; a check with a variable of its own names it
BEGINNINGS = {
    COMPUTER: ("computer", "gateways", "router", "roscore", "masters", "where `"),
    ITSELF_TOO: ("pair, itself too",),
    MEMBER: ("pair", "to gateways"),
    MASTER: ("to masters",),
    MASTER_TOO: ("to masters",),
    ROSCORES: ("pair of roscores",),
}


@pytest.mark.parametrize("name, whom", [row[:2] for row in read_rows()])
def test_the_page_says_for_whom_a_check_is(name, whom):
    scope = next(check.scope for check in CHECKS if check.id == name)
    assert whom.startswith((*BEGINNINGS[scope], "with `"))


def test_what_is_expected_is_said_with_sections_of_the_report():
    assert all(expected.strip() for _name, _who, expected, _report in read_rows())
    assert all(
        re.fullmatch(r"|(\d(\.\d)?|Fig\. \d+)(, (\d(\.\d)?|Fig\. \d+))* ", report) for *_words, report in read_rows()
    )
