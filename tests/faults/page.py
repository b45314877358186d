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
END = "<!-- end of faults -->"


def table(rows: Iterable[tuple[Fault, Row | None]]) -> str:
    """A row for each fault: its file, what it is, the part that is expected, what was named, and if its remedy mends it."""
    lines = ["| fault | | expected | named | remedy mends |", "|---|---|---|---|---|"]
    for fault, row in rows:
        part = f"`{' '.join(fault.parts[0])}` of {fault.at[0]}"
        verdict = row.verdict if row else UNTRIED
        mends = (row.remedied.partition(":")[0] if row else "") or UNTRIED
        lines.append(f"| `{fault.name}` | {fault.title} | {part} | {verdict} | {mends} |")
    return "\n".join(lines)


def write(rows: Iterable[tuple[Fault, Row | None]], beneath: str = "") -> None:
    """Replace what stands between the marks by the table, and a sentence beneath it."""
    before, _begin, rest = PAGE.read_text(encoding="utf-8").partition(BEGIN)
    _old, _end, after = rest.partition(END)
    parts = filter(None, (f"{before}{BEGIN}", table(rows), beneath, f"{END}{after}"))
    PAGE.write_text("\n\n".join(parts), encoding="utf-8")
