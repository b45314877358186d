# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The references: each table is that of the code, each row has its words, and a cell is short."""

import pytest
from rosfleet_multimaster.protocol.parameters import DISCOVERY, RELAY, SYNC

from tools import references

TABLES = {f"{table.document}, {table.name}": table for table in references.list_tables()}


def read_rows(table):
    page = (references.ROOT / table.document).read_text(encoding="utf-8")
    return references.read_table(page.partition(f"<!-- {table.name}: ")[2].partition("<!-- end of ")[0])


@pytest.mark.parametrize("name", TABLES)
def test_a_table_is_that_of_the_code(name):
    page = (references.ROOT / TABLES[name].document).read_text(encoding="utf-8")
    assert TABLES[name].fill(page, "references") == page, "run `make references`"


@pytest.mark.parametrize("name", TABLES)
def test_each_cell_has_words_and_not_many(name):
    rows = read_rows(TABLES[name])
    assert len(rows) > 1
    cells = [cell for row in rows.values() for cell in row.values()]
    assert references.MISSING not in cells
    assert [cell for cell in cells if len(cell.split()) > references.CELL] == []


def test_a_new_row_asks_for_words_and_the_words_of_others_stay():
    old = "| name | default | meaning |\n|---|---|---|\n| `a` | 1 | the first |\n| `gone` | 2 | words |\n"
    made = references.lay_out("name|default|meaning", [("`a`", "3", None), ("`b`", "4", None)], old)
    assert made.splitlines()[2:] == ["| `a` | 3 | the first |", f"| `b` | 4 | {references.MISSING} |"]


def test_each_parameter_stands_in_one_row():
    of_nodes = {"master_discovery": DISCOVERY, "master_sync": SYNC, "master_relay": RELAY}
    page = "docs/operate/node_parameters.md"
    shared = [name for row in read_rows(TABLES[f"{page}, all nodes"]) for name in references.find_names(row)]
    for node, table in of_nodes.items():
        own = [name for row in read_rows(TABLES[f"{page}, {node}"]) for name in references.find_names(row)]
        assert sorted([*shared, *own]) == sorted(table)


def test_a_sentence_loses_its_example_alone():
    assert (
        references.drop_examples("an IPv4 network such as 192.168.1.0/24, without host bits")
        == "an IPv4 network, without host bits"
    )
    assert references.drop_examples("a list of entries such as {from: a, names: [/b]}") == "a list of entries"
    assert (
        references.describe_option(["Seconds of a start, for example V(9); V(0) never. Second.", "More."])
        == "Seconds of a start; `0` never. Second."
    )
