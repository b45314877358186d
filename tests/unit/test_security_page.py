# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""docs/operate/security.md, its evidence and the tests: each test that a page names is there, and its figures are those of the code.

On both pages, `[✓][name]` stands beside a promise; `name` is defined at the end of the page, with a file and the tests that try it
by behaviour. The attacks have a table in the evidence.
"""

import ast
import re
from pathlib import Path

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._base import commands, foreign, trust
from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine import ros
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.ros_client import documents, node, xml_rpc
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._robot_io import answer, robot_action
from rosfleet_multimaster import end_connections
from rosfleet_multimaster.discovery.core import report as report_of_discovery
from rosfleet_multimaster.edge import rpc_client, rpc_server
from rosfleet_multimaster.sync.core import limits
from rosfleet_multimaster.sync.core import report as report_of_sync

ROOT = Path(__file__).resolve().parents[2]

PAGE = (ROOT / "docs/operate/security.md").read_text(encoding="utf-8")
EVIDENCE = (ROOT / "tests/evidence/security.md").read_text(encoding="utf-8")
PAGES = sorted(
    page
    for page in [*ROOT.glob("docs/**/*.md"), *ROOT.glob("tests/evidence/*.md"), ROOT / "README.md"]
    if page.name != "adding.md"
)  # it has examples
NAMED = re.compile(r"tests/[\w/.]*test_\w+\.py")

ATTACKS = "Attacks, and the test of each"
MARK = re.compile(r"\s*\[✓\]\[([\w-]+)\]")
DEFINITION = re.compile(r'^\[([\w-]+)\]: \.\./\.\./(tests/\S+)(?: "([^"]+)")?$', re.MULTILINE)

KIB, MIB = 1 << 10, 1 << 20
#: words of the page -> the same in code
FIGURES = {
    "(`multimaster: strangers`)": report_of_discovery.outsiders([]).name == "multimaster: strangers",
    "(`multimaster: places`)": "multimaster: places" in {entry.name for entry in report_of_sync.diagnoses([])},
    "at most 64 KiB of variables": ros._LARGEST / KIB == 64,
    "one line of JSON of at most 256 KiB": foreign._LONGEST / KIB == 256,
    "64 KiB a question, 900 connections, 10 s": (node._BYTES / KIB, node._CONNECTIONS, node.REQUEST) == (64, 900, 10),
    "root's files stay as they are [✓][verified]; 4 MiB": commands.MOST / MIB == 4,
    "10,000 parts of paths and 5 s": (trust.MOST, trust.LIMIT) == (10_000, 5),
    "more than 16 Mi characters, a million values, 24 of them in each other, a number of more than 20 digits": (
        (answer.MOST_TEXT / MIB, answer.MOST_VALUES, answer.DEEPEST, answer.DIGITS) == (16, 1_000_000, 24, 20)
    ),
    "more than 96 MiB while it comes, or for more than half an hour": (robot_action.MEMORY / MIB, robot_action.LONGEST)
    == (96, 1800),
    "| an answer of another computer | 64 KiB": documents.ANSWER / KIB == 64,
    "| of a node of this robot | 2 MiB": documents.NODE / MIB == 2,
    "| the state of a master, and what the own roscore says | 16 MiB": documents.STATE / MIB == 16,
    "and 1 MiB, but 25 MiB at most": (documents._SPARE / MIB, (documents._SPARE + documents._DEAR) / MIB) == (1, 25),
    "| 100 elements, 400 digits, 4 MiB, 128 KiB": (
        (documents._NESTING, documents._NUMBER, documents._TEXT / MIB, documents._TOKEN / KIB) == (100, 400, 4, 128)
    ),
    "| 32 KiB together": rpc_client._HEAD / KIB == 32,
    "one above 512 KiB": rpc_client.SMALL / KIB == 512,
    "5,000 of its own": limits.MOST == 5000,
    "has 64 connections, and two more for each robot, 15 s each; of one robot 16": (
        (rpc_server._MAX_CONNECTIONS, rpc_server._FOR_EACH, rpc_server._MAX_SECONDS, rpc_server._MAX_OF_ONE)
        == (64, 2, 15, 16)
    ),
    "with 5 s for a call": xml_rpc.CALL == 5,
    "256 connections a second at most": end_connections.PER_SECOND == 256,
}


def section(title):
    return EVIDENCE.partition(f"\n## {title}\n")[2].partition("\n## ")[0]


@pytest.mark.parametrize(("page", "least"), [(PAGE, 40), (EVIDENCE, 150)], ids=["page", "evidence"])
def test_each_mark_is_defined_and_each_definition_is_used(page, least):
    names = [name for name, _path, _tests in DEFINITION.findall(page)]
    used = set(MARK.findall(page))
    assert len(names) == len(set(names)) > least
    assert used == set(names)
    assert len(re.findall(r"^\[[^\]]+\]:", page, re.MULTILINE)) == len(names), "each line at the end is a definition"
    assert page.count("[✓]") == sum(1 for _mark in MARK.finditer(page)), "each mark has a name"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("path", "tests"),
    sorted({(path, tests) for _name, path, tests in DEFINITION.findall(PAGE + EVIDENCE)}),
    ids=lambda text: text,
)
def test_each_test_beside_a_promise_is_there(path, tests):
    assert NAMED.fullmatch(path), path
    body = ast.parse((ROOT / path).read_text(encoding="utf-8")).body
    there = {entry.name for entry in body if isinstance(entry, ast.FunctionDef) and entry.name.startswith("test_")}
    assert there
    assert set(filter(None, tests.split(", "))) <= there


@pytest.mark.parametrize("words", FIGURES)
def test_a_figure_of_the_page_is_that_of_the_code(words):
    assert words in " ".join((PAGE + EVIDENCE).split())
    assert FIGURES[words]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_test_that_a_page_names_is_there(page):
    assert [name for name in NAMED.findall(page.read_text()) if not (ROOT / name).is_file()] == []


def test_every_attack_has_a_test():
    rows = [line for line in section(ATTACKS).splitlines() if line.startswith("| ")][1:]
    assert len(rows) > 30
    for row in rows:
        tests = row.rsplit("|", 2)[1]
        assert NAMED.search(tests), row
        assert set(re.findall(r"[\w/]*test_\w+\.py", tests)) == set(NAMED.findall(tests)), row
