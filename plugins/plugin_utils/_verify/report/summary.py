# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The summary of the rows of a verification. Pure."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

from ..checks.engine import FAILED, OK, UNKNOWN, WARNING, Passed, Row

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

    @property
    def verdict_line(self) -> str:
        """The result in one sentence."""
        numbers = ((self.count(WARNING), "with a warning"), (self.count(UNKNOWN), "not judged"))
        others = ", ".join(f"{number} {words}" for number, words in numbers if number)
        failed = self.count(FAILED)
        begin = f"FAILED: {failed}" if failed else "PASSED: none"
        return f"{begin} of {self.total} checks failed{f' ({others})' if others else ''}."


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
