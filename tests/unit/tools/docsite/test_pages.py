# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Links of the pages as they are on the site, and its table of contents."""

import re
from pathlib import Path

import pytest

from tools.docsite import build, pages

ROOT = Path(__file__).resolve().parents[4]
TREE = pages.Tree(
    frozenset(
        {
            "README.md",
            "docs/README.md",
            "docs/start/machines.md",
            "docs/images/report-well.png",
            "Makefile",
            "lab/nodes/a.py",
        }
    ),
    "https://host/project",
)


@pytest.mark.parametrize(
    ("page", "link", "there"),
    [
        ("README.md", "docs/start/machines.md#two", "docs/start/machines.md#two"),
        ("docs/start/machines.md", "../../README.md#three-commands", "../../index.md#three-commands"),
        ("docs/start/machines.md", "../README.md", "../README.md"),
        ("README.md", "docs", "docs/README.md"),
        ("docs/start/machines.md", "../images/report-well.png", "../images/report-well.png"),
        ("docs/start/machines.md", "../../roles/hosts/README.md", "../../reference/hosts_role.rst"),
        ("docs/start/machines.md", "../../roles/hosts", "../../reference/hosts_role.rst"),
        ("README.md", "plugins/modules/routes.py", "reference/routes_module.rst"),
        ("README.md", "plugins/filter/file_sums.py", "reference/file_sums_filter.rst"),
        ("README.md", "plugins/lookup/file_tree.py", "reference/file_tree_lookup.rst"),
        ("docs/start/machines.md", "../../Makefile", "https://host/project/blob/main/Makefile"),
        ("docs/start/machines.md", "../../lab/nodes", "https://host/project/tree/main/lab/nodes"),
        ("docs/start/machines.md", "#two", "#two"),
        ("docs/start/machines.md", "https://elsewhere/x.md", "https://elsewhere/x.md"),
    ],
)
def test_a_link_leads_to_the_site_or_the_repository(page, link, there):
    assert TREE.turn_link(page, link) == there


def test_code_stays_as_it_is():
    page = "[a](../../Makefile) `[b](../../Makefile)`\n```\n[c](../../Makefile)\n```\n[d]: ../../Makefile\n"
    assert TREE.turn_page("docs/start/machines.md", page).count("https://host/project/blob/main/Makefile") == 2


def test_each_page_stands_in_the_contents_once():
    tree = build.read_tree()
    contents = pages.write_contents(pages.list_shelves((ROOT / pages.INDEX).read_text(encoding="utf-8")))
    listed = re.findall(r"^([\w/]+)$", contents, re.MULTILINE)
    shown = [name.rpartition(".")[0] for name in tree.list_shown() if name.endswith((".md", ".rst"))]
    assert sorted(listed) == sorted([*shown, "reference/index"]) and len(shown) > 30
