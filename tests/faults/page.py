# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The table of the catalogue in tests/evidence/faults.md, between two marks."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from catalogue import Fault
from kept import Row

PAGE = Path(__file__).resolve().parents[2] / "tests" / "evidence" / "faults.md"
BEGIN = "<!-- faults: written by `make test-faults` -->"
UNTRIED = "not tried"
CELLS = 5
END = "<!-- end of faults -->"


def table(rows: Iterable[tuple[Fault, Row | None]]) -> str:
    """A row for each fault: its file, what it is, the part that is expected, what was named, and if its remedy mends it."""
    lines = ["| fault | | expected | named | remedy mends |", "|---|---|---|---|---|"]
    for fault, row in rows:
        part = _describe_part(fault)
        verdict = row.verdict if row else UNTRIED
        mends = (row.remedied.partition(":")[0] if row else "") or UNTRIED
        lines.append(f"| `{fault.name}` | {fault.title} | {part} | {verdict} | {mends} |")
    return "\n".join(lines)


def _describe_part(fault: Fault) -> str:
    return f"`{' '.join(fault.parts[0])}` of {fault.at[0]}"


def read(faults: Iterable[Fault], page: str | None = None) -> dict[Fault, Row]:
    """Return the rows that the page has of these faults, with what a table tells. A fault whose expected part has changed has no row."""
    text = PAGE.read_text(encoding="utf-8") if page is None else page
    lines = {line.split("`")[1]: line.split(" | ") for line in text.splitlines() if line.startswith("| `")}
    found = {}
    for fault in faults:
        cells = lines.get(fault.name, [])
        if len(cells) == CELLS and cells[2] == _describe_part(fault) and cells[3] != UNTRIED:
            mends = cells[4].removesuffix(" |")
            found[fault] = Row(cells[3], "", 0.0, 0, 0, "", remedied="" if mends == UNTRIED else mends)
    return found


def find_sentence(begin: str) -> str:
    """Return the sentence beneath the table that begins with these words; empty if no sentence does."""
    _before, _begin, rest = PAGE.read_text(encoding="utf-8").partition(BEGIN)
    beneath = rest.partition(END)[0].strip().splitlines()[-1:]
    return next((f"{one.rstrip('.')}." for one in "".join(beneath).split(". ") if one.startswith(begin)), "")


def write(rows: Iterable[tuple[Fault, Row | None]], beneath: str = "") -> None:
    """Replace what stands between the marks by the table, and a sentence beneath it."""
    before, _begin, rest = PAGE.read_text(encoding="utf-8").partition(BEGIN)
    _old, _end, after = rest.partition(END)
    parts = filter(None, (f"{before}{BEGIN}", table(rows), beneath, f"{END}{after}"))
    PAGE.write_text("\n\n".join(parts), encoding="utf-8")
