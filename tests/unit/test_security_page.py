# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The tests that the pages name are there, and every attack has one."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGES = sorted(
    page for page in [*ROOT.glob("docs/*.md"), ROOT / "README.md"] if page.name != "adding.md"
)  # it has examples
NAMED = re.compile(r"tests/[\w/.]*test_\w+\.py")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_test_that_a_page_names_is_there(page):
    assert [name for name in NAMED.findall(page.read_text()) if not (ROOT / name).is_file()] == []


def test_every_attack_has_a_test():
    table = (
        (ROOT / "docs/security.md").read_text().partition("## Attacks, and the test of each")[2].partition("\n## ")[0]
    )
    rows = [line for line in table.splitlines() if line.startswith("| ")][1:]
    assert len(rows) > 30
    for row in rows:
        tests = row.rsplit("|", 2)[1]
        assert NAMED.search(tests), row
        assert set(re.findall(r"[\w/]*test_\w+\.py", tests)) == set(NAMED.findall(tests)), row
