# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Rows and findings as a table for the terminal and as data for a file.

Pure: what was judged in, text out.
"""

from __future__ import annotations

import textwrap
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import count
from typing import Any

from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._checks.engine import (
    FAILED,
    OK,
    UNKNOWN,
    VERDICTS,
    WARNING,
    Passed,
    Row,
    Verification,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._checks.table import CHECKS, TITLES
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._diagnosis.diagnosis import Diagnosis, Finding

WIDTH = 120
MATRIX = 16  # computers: a larger matrix is no longer read
CELL = 8  # columns of one of them, where there is room
SENTENCES = 20  # findings that are printed; all are in the file
PAIRS = 4  # pairs, names or networks that are named in one of them
WORST = (FAILED, UNKNOWN, WARNING, OK)


@dataclass
class Summary:
    """The summary of a stream of rows: numbers, the rows that are not ok, and the matrix where it is small."""

    computers: Sequence[str]  # of this run
    fleet: int  # computers of the fleet
    pairs: tuple[int, int] = (0, 0)  # that were to be tried, and all that there are
    counts: dict[str, Counter[str]] = field(default_factory=lambda: defaultdict(Counter))
    notable: list[Row] = field(default_factory=list)
    cells: dict[tuple[str, str], Counter[str]] = field(default_factory=lambda: defaultdict(Counter))

    def number(self, verdict: str) -> int:
        """Count the rows with a verdict."""
        return sum(counts[verdict] for counts in self.counts.values())

    @property
    def total(self) -> int:
        """Count all rows."""
        return sum(counts.total() for counts in self.counts.values())


def summarise(
    rows: Iterable[Row],
    computers: Sequence[str],
    fleet: int,
    pairs: tuple[int, int] = (0, 0),
    passed: Passed | None = None,
) -> Summary:
    """Look at every row once; `passed` counts those that are not made, and is complete when the last row is."""
    summary = Summary(computers, fleet, pairs)
    small = fits(computers)
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


def summarised(verification: Verification, computers: Sequence[str], fleet: int) -> Summary:
    """Judge everything, and keep only what is read: in a large fleet, of what is good the numbers."""
    passed: Passed | None = None if fits(computers) else Counter()
    return summarise(verification.rows(passed), computers, fleet, verification.pairs, passed)


def fits(computers: Sequence[str]) -> bool:
    """Say if there are so few computers that the matrix is printed."""
    return len(computers) <= MATRIX


def render(summary: Summary, diagnosis: Diagnosis, width: int = WIDTH, everything: bool = True) -> str:
    """The report for the terminal, as wide as this where names allow it; without `everything` only what is wrong."""
    parts = [_title(summary), _table(summary)] if everything else [_title(summary)]
    if everything and len(summary.computers) > 1 and fits(summary.computers):
        parts.append(_matrix(summary))
    numbers = count(1)
    if diagnosis.looked_at < diagnosis.total:
        parts.append(f"Explained are {diagnosis.looked_at} of {diagnosis.total} results that are not as expected.")
    for verdict, heading in ((FAILED, "Findings"), (WARNING, "Warnings"), (UNKNOWN, "Not judged")):
        parts += _findings([entry for entry in diagnosis.findings if entry.verdict == verdict], heading, numbers, width)
    parts += _unexplained(diagnosis.unexplained, width)
    parts.append(verdict_line(summary))
    return "\n\n".join(parts)


def _title(summary: Summary) -> str:
    if len(summary.computers) == summary.fleet:
        title = f"VERIFICATION of {summary.fleet} computers"
    else:
        title = f"VERIFICATION of {len(summary.computers)} of {summary.fleet} computers; the others are not in this run"
    return title + _sample(summary)


def _sample(summary: Summary) -> str:
    """Say how many pairs of a large fleet were left out."""
    some, everything = summary.pairs
    if some == everything:
        return ""
    return (
        f"\n{some} of {everything} pairs were tried: every way between two networks, and every computer in both directions "
        f"at least twice. verify_pairs: all tries all."
    )


def _table(summary: Summary) -> str:
    checks = [check for check in CHECKS if check.id in summary.counts]
    width = max([len(check.title) for check in checks], default=0)
    lines = [f"  {'check':<{width}}  " + "".join(f"{verdict:>9}" for verdict in VERDICTS)]
    for check in checks:
        numbers = "".join(f"{summary.counts[check.id][verdict] or '-':>9}" for verdict in VERDICTS)
        lines.append(f"  {check.title:<{width}}  {numbers}")
    return "\n".join(lines)


def _matrix(summary: Summary) -> str:
    """Rows observe, columns are observed; a computer's own checks are where it meets itself."""
    numbers = range(1, len(summary.computers) + 1)
    width = max(len(name) for name in summary.computers)
    cell = max(5, min(CELL, (WIDTH - width - 6) // len(summary.computers)))
    lines = [f"  {'from / to':<{width + 4}}" + "".join(f"{number:>{cell}}" for number in numbers)]
    for number, observer in zip(numbers, summary.computers, strict=True):
        cells = "".join(f"{_cell(summary.cells.get((observer, target)), cell):>{cell}}" for target in summary.computers)
        lines.append(f"  {number:>2}  {observer:<{width}}{cells}")
    return "\n".join(lines)


def _cell(counts: Mapping[str, int] | None, width: int) -> str:
    if not counts:
        return "-"
    worst = next(verdict for verdict in WORST if counts.get(verdict))
    if worst == FAILED:
        text = f"FAIL {counts[FAILED]}"
        return text if len(text) < width else "FAIL"
    return {UNKNOWN: "?", WARNING: "warn", OK: "ok"}[worst]


def _findings(findings: Sequence[Finding], heading: str, numbers: Iterator[int], width: int) -> list[str]:
    if not findings:
        return []
    lines = [f"{heading}:"]
    for entry, number in zip(findings[:SENTENCES], numbers, strict=False):
        lines += _filled(((label.format(number=number), text) for label, text in _finding(entry)), width)
    if len(findings) > SENTENCES:
        lines.append(f"  and {len(findings) - SENTENCES} more: all are in the file that verify_report names.")
    return ["\n".join(lines)]


def _finding(entry: Finding) -> Iterator[tuple[str, str]]:
    """The lines of a finding: (label, text)."""
    if entry.rivals:
        yield "{number:>3}. ", "one of these: " + "; or ".join(part.sentence() for part in entry.candidates)
    else:
        yield "{number:>3}. ", entry.sentence()
    for row in entry.proof[:1]:
        yield "     seen:     ", f"{_where(entry.proof)}: expected {row.expected}, found {row.found}"
    if not entry.proof:
        yield "     for it:   ", _counted(row.check for row in entry.rows) + " fail" + _example(entry.rows)
        if entry.passed:
            yield "     besides:  ", "in the same pairs these succeed: " + _counted(entry.passed)
    elif entry.rows:
        yield "     follows:  ", _counted(row.check for row in entry.rows)
    yield "     since:    ", entry.since
    yield "     behind:   ", _behind(entry)
    if entry.rivals:
        yield "     decide:   ", "; ".join(dict.fromkeys(part.decide() for part in entry.candidates))
    yield "     do:       ", entry.remedy()


def _example(rows: Sequence[Row]) -> str:
    """The first of some rows, with what was found."""
    return f"; such as {whom(rows[0])}: {rows[0].found}" if rows and rows[0].found else ""


def _behind(entry: Finding) -> str:
    """The computers that could not be looked at because of it."""
    names = dict.fromkeys(row.observer for row in entry.rows if row.check == "reachable")
    others = [name for name in names if name != entry.part.place]
    more = f" and {len(others) - PAIRS} more" if len(others) > PAIRS else ""
    return f"not examined: {', '.join(others[:PAIRS])}{more}" if others else ""


def _where(rows: Sequence[Row]) -> str:
    """The check and the pairs of some rows."""
    pairs = list(dict.fromkeys(whom(row) for row in rows if row.check == rows[0].check))
    more = f" and {len(pairs) - PAIRS} more" if len(pairs) > PAIRS else ""
    return f"{TITLES[rows[0].check]}: {', '.join(pairs[:PAIRS])}{more}"


def _counted(checks: Iterable[str]) -> str:
    """Titles of checks with how often each is there."""
    counted = Counter(checks).most_common()
    more = f" and {len(counted) - PAIRS} other checks" if len(counted) > PAIRS else ""
    return ", ".join(f"{TITLES[check]} ({number})" for check, number in counted[:PAIRS]) + more


def _unexplained(rows: Sequence[Row], width: int) -> list[str]:
    """Return the rows that no part explains without a success against it: a few packets were lost, or more than one thing is odd."""
    if not rows:
        return []
    lines = ["Not explained (lost packets, or something that comes and goes: run it again):"]
    groups: dict[str, list[Row]] = defaultdict(list)
    for row in rows:
        groups[row.check].append(row)
    for group in groups.values():
        text = f"{_where(group)}: expected {group[0].expected}, found {group[0].found}"
        lines += _filled([("   -  ", text)], width)
    return ["\n".join(lines)]


def _filled(rows: Iterable[tuple[str, str]], width: int) -> list[str]:
    return [filled(label, text, width) for label, text in rows if text]


def filled(label: str, text: str, width: int) -> str:
    """A text behind its label, as wide as this. Where a line begins within a quotation, a quote says so."""
    lines, within = [], False
    for line in textwrap.wrap(text, max(width - len(label), 20), break_long_words=False, break_on_hyphens=False):
        lines.append(f'"{line}' if within else line)
        within ^= line.count('"') % 2 == 1
    return label + f"\n{' ' * len(label)}".join(lines)


def whom(row: Row) -> str:
    """The computer, or the pair, of a row."""
    return row.observer if row.observer == row.target else f"{row.observer} -> {row.target}"


def verdict_line(summary: Summary) -> str:
    """The result in one sentence."""
    failed = summary.number(FAILED)
    others = [
        f"{summary.number(verdict)} {word}"
        for verdict, word in ((WARNING, "with a warning"), (UNKNOWN, "not judged"))
        if summary.number(verdict)
    ]
    more = f" ({', '.join(others)})" if others else ""
    if failed:
        return f"FAILED: {failed} of {summary.total} checks failed{more}."
    return f"PASSED: none of {summary.total} checks failed{more}."


def document(summary: Summary, diagnosis: Diagnosis, rows: Sequence[Row]) -> dict[str, Any]:
    """All findings and rows as plain data."""
    return {
        "computers": list(summary.computers),
        "pairs": sampled(summary),
        "verdict": FAILED if summary.number(FAILED) else OK,
        "checks": counts(summary),
        "findings": findings(diagnosis, listed=True),
        "unexplained": [row._asdict() for row in diagnosis.unexplained],
        "rows": [row._asdict() for row in rows],
    }


def sampled(summary: Summary) -> dict[str, int]:
    """How many pairs of computers were to be tried, of how many."""
    return dict(zip(("tried", "of"), summary.pairs, strict=True))


def findings(diagnosis: Diagnosis, listed: bool = False) -> list[dict[str, Any]]:
    """The findings as plain data; what follows from each is counted, or listed."""
    return [
        {
            "kind": entry.part.kind,
            "place": entry.part.place,
            "mode": entry.part.mode,
            "what": entry.subjects,
            "verdict": entry.verdict,
            "sentence": entry.sentence(),
            "remedy": entry.remedy(),
            "decide": entry.part.decide(),
            "since": entry.since,
            "rivals": [
                {"kind": part.kind, "place": part.place, "mode": part.mode, "sentence": part.sentence()}
                for part in entry.rivals
            ],
            "seen": [row._asdict() for row in entry.proof],
            "follows": [row._asdict() for row in entry.rows] if listed else len(entry.rows),
        }
        for entry in diagnosis.findings
    ]


def counts(summary: Summary) -> list[dict[str, Any]]:
    """One entry per check that was made: its id, its title, and how many rows have each verdict."""
    return [
        {
            "check": check.id,
            "title": check.title,
            **{verdict: summary.counts[check.id][verdict] for verdict in VERDICTS},
        }
        for check in CHECKS
        if check.id in summary.counts
    ]
