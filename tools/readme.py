# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Write the tables of measurements into the pages.

With `--check` nothing is written; a table that is not the generated one is an error.
"""

from __future__ import annotations

import os
import pathlib
import re
import sys
from collections.abc import Callable, Iterator
from typing import NamedTuple

ROOT = pathlib.Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT / "tests/bench" / folder) for folder in ("", "network", "site")]

import figures  # noqa: E402
import growth  # noqa: E402
import in_tree  # noqa: E402

_PAGE = re.compile(r"docs/(?:\w+/)*(\w+)\.md")


class Table(NamedTuple):
    """A generated table: its document, its name in the marks around it, and its source."""

    document: str
    name: str
    source: str
    make: Callable[[], str]

    def fill(self, text: str) -> str:
        """Return a document with the current table between its two marks."""
        begin = f"<!-- {self.name}: generated from {self.source} by `make readme` -->\n"
        end = f"<!-- end of {self.name} -->\n"
        head, mark, rest = text.partition(begin)
        _old, end_mark, tail = rest.partition(end)
        if not mark or not end_mark:
            raise SystemExit(f"{self.document} has no pair of lines {begin.strip()} and {end.strip()}; restore them.")
        return f"{head}{begin}\n{_PAGE.sub(self._link, self.make())}\n{end}{tail}"

    def _link(self, page: re.Match[str]) -> str:
        """Return a link to a page that the table names, as it is written in this document."""
        return f"[{page[1].replace('_', ' ')}]({os.path.relpath(page[0], os.path.dirname(self.document))})"


def list_measured_tables() -> Iterator[Table]:
    """List the tables of the figures that are kept in the tree."""
    page, bench = "docs/understand/performance.md", "tests/bench/{}/README.md"
    network, grown = in_tree.read("network"), in_tree.read("growth")
    sources = [str((in_tree.FOLDER / f"{name}.json").relative_to(ROOT)) for name in ("network", "growth")]
    yield Table(page, "network", sources[0], lambda: figures.table(network["systems"], network["titles"]))
    yield Table(bench.format("network"), "crowd", sources[0], lambda: figures.crowd_table(network["crowd"]))
    yield Table(bench.format("site"), "site", sources[1], lambda: growth.site_table(grown))
    yield Table(bench.format("site"), "functions", sources[1], lambda: growth.functions_table(grown))


def main() -> int:
    different = 0
    for table in list_measured_tables():
        path = ROOT / table.document
        before = path.read_text(encoding="utf-8")
        after = table.fill(before)
        if before == after:
            continue
        different += 1
        if "--check" in sys.argv[1:]:
            print(f"{table.document}: the table of {table.name} is not the one of {table.source}; run `make readme`.")
        else:
            path.write_text(after, encoding="utf-8")
    return int("--check" in sys.argv[1:] and different > 0)


if __name__ == "__main__":
    sys.exit(main())
