# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Generated tables between two marks of a page. With `--check` nothing is written; a table that is not the generated one is an error."""

from __future__ import annotations

import os
import pathlib
import re
import sys
from collections.abc import Callable, Iterable
from typing import NamedTuple

ROOT = pathlib.Path(__file__).resolve().parent.parent
_PAGE = re.compile(r"docs/(?:\w+/)*(\w+)\.md")


class Table(NamedTuple):
    """A generated table: its document, its name in the marks around it, its source, and what makes it of the former one."""

    document: str
    name: str
    source: str
    make: Callable[[str], str]

    def fill(self, text: str, target: str) -> str:
        """Return a document with the current table between its two marks."""
        begin = f"<!-- {self.name}: generated from {self.source} by `make {target}` -->\n"
        end = f"<!-- end of {self.name} -->\n"
        head, mark, rest = text.partition(begin)
        old, end_mark, tail = rest.partition(end)
        if not mark or not end_mark:
            raise SystemExit(f"{self.document} has no pair of lines {begin.strip()} and {end.strip()}; restore them.")
        return f"{head}{begin}\n{_PAGE.sub(self._link, self.make(old))}\n{end}{tail}"

    def _link(self, page: re.Match[str]) -> str:
        """Return a link to a page that the table names, as it is written in this document."""
        return f"[{page[1].replace('_', ' ')}]({os.path.relpath(page[0], os.path.dirname(self.document))})"


def write(tables: Iterable[Table], target: str) -> int:
    """Write the tables that differ, or name them with `--check`. Return the status of the program; `target` is that of the Makefile."""
    checks, different = "--check" in sys.argv[1:], 0
    for table in tables:
        path = ROOT / table.document
        before = path.read_text(encoding="utf-8")
        after = table.fill(before, target)
        if before == after:
            continue
        different += 1
        if checks:
            print(f"{table.document}: the table of {table.name} is not the one of {table.source}; run `make {target}`.")
        else:
            path.write_text(after, encoding="utf-8")
    return int(checks and different > 0)
