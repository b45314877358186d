# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The summary of the rows of a verification. Pure."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

from ..checks.engine import FAILED, OK, UNKNOWN, WARNING, Passed, Row
from ..diagnose.diagnosis import Diagnosis

MATRIX = 16  # computers: a larger matrix is no longer read on a terminal


@dataclass
class Summary:
    """Numbers of rows, the rows that are not ok, and the cells of the matrix of a small run."""

    computers: Sequence[str]  # of this run
    fleet: int  # computers of the fleet
    pairs: tuple[int, int] = (0, 0)  # that were to be tried, and all that there are
    counts: dict[str, Counter[str]] = field(default_factory=lambda: defaultdict(Counter))
    notable: list[Row] = field(default_factory=list)
    cells: dict[tuple[str, str], Counter[str]] = field(default_factory=lambda: defaultdict(Counter))

    def count(self, verdict: str) -> int:
        """Count the rows with a verdict."""
        return sum(counts[verdict] for counts in self.counts.values())

    @property
    def total(self) -> int:
        """The number of all rows."""
        return sum(counts.total() for counts in self.counts.values())


def write_result(summary: Summary, diagnosis: Diagnosis) -> str:
    """Write the result in one sentence: the failed checks, and what the list under each heading of the report has."""
    found = Counter(entry.verdict for entry in diagnosis.findings)
    listed = (
        (found[FAILED], "finding", "findings"),
        (found[WARNING], "warning", "warnings"),
        (found[UNKNOWN], "not judged", "not judged"),
        (len({row.check for row in diagnosis.unexplained}), "not explained", "not explained"),
    )
    words = ", ".join(f"{number} {one if number == 1 else more}" for number, one, more in listed if number)
    failed = summary.count(FAILED)
    begin = f"FAILED: {failed}" if failed else "PASSED: none"
    return f"{begin} of {summary.total} checks failed{f'; the list has {words}' if words else ''}."


def is_small(computers: Sequence[str]) -> bool:
    """Return True if the matrix of so few computers is printed."""
    return len(computers) <= MATRIX


def summarise(
    rows: Iterable[Row],
    computers: Sequence[str],
    fleet: int,
    pairs: tuple[int, int] = (0, 0),
    passed: Passed | None = None,
) -> Summary:
    """Look at each row once. `passed` counts good results without a row."""
    summary = Summary(computers, fleet, pairs)
    small = is_small(computers)
    for row in rows:
        summary.counts[row.check][row.verdict] += 1
        if row.verdict != OK:
            summary.notable.append(row)
        if small:
            summary.cells[row.observer, row.target][row.verdict] += 1
    for (_own, _its, checks), number in (passed or {}).items():
        for check in checks:
            summary.counts[check][OK] += number
    return summary
