# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Findings as a table for the terminal and as data for a file.

Pure: findings in, text out.
"""

from __future__ import annotations

import textwrap
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.checks import CHECKS, TITLES
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.engine import (
    FAILED,
    OK,
    UNKNOWN,
    VERDICTS,
    WARNING,
    Finding,
)

WIDTH = 120
MATRIX = 16  # computers: a larger matrix is no longer read
CELL = 8  # columns of one of them, where there is room
SENTENCES = 20  # groups of findings that are printed; all are in the file
PAIRS = 4  # pairs that are named in one of them
WORST = (FAILED, UNKNOWN, WARNING, OK)


@dataclass
class Summary:
    """The summary of a stream of findings: numbers, the findings that are not ok, and the matrix where it is small."""

    computers: Sequence[str]  # of this run
    fleet: int  # computers of the fleet
    counts: dict[str, Counter[str]] = field(default_factory=lambda: defaultdict(Counter))
    notable: list[Finding] = field(default_factory=list)
    cells: dict[tuple[str, str], Counter[str]] = field(default_factory=lambda: defaultdict(Counter))

    def number(self, verdict: str) -> int:
        """Count the findings with a verdict."""
        return sum(counts[verdict] for counts in self.counts.values())

    @property
    def total(self) -> int:
        """Count all findings."""
        return sum(counts.total() for counts in self.counts.values())


def summarise(findings: Iterable[Finding], computers: Sequence[str], fleet: int) -> Summary:
    """Look at every finding once."""
    summary = Summary(computers, fleet)
    small = len(computers) <= MATRIX
    for finding in findings:
        summary.counts[finding.check][finding.verdict] += 1
        if finding.verdict != OK:
            summary.notable.append(finding)
        if small:
            summary.cells[finding.observer, finding.target][finding.verdict] += 1
    return summary


def render(summary: Summary) -> str:
    """The report for the terminal, at most 120 columns wide where names allow it."""
    parts = [_title(summary), _table(summary)]
    if 1 < len(summary.computers) <= MATRIX:
        parts.append(_matrix(summary))
    for verdict, heading in ((FAILED, "Failed"), (WARNING, "Warnings"), (UNKNOWN, "Not judged")):
        parts += _sentences(summary, verdict, heading)
    parts.append(verdict_line(summary))
    return "\n\n".join(parts)


def _title(summary: Summary) -> str:
    if len(summary.computers) == summary.fleet:
        return f"VERIFICATION of {summary.fleet} computers"
    return f"VERIFICATION of {len(summary.computers)} of {summary.fleet} computers; the others are not in this run"


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


def _sentences(summary: Summary, verdict: str, heading: str) -> list[str]:
    """The findings that no other one explains, those with the same cause together."""
    groups: dict[tuple[str, str, str], list[Finding]] = defaultdict(list)
    explained = 0
    for finding in summary.notable:
        if finding.verdict == verdict and finding.because:
            explained += 1
        elif finding.verdict == verdict:
            groups[finding.check, finding.cause, finding.remedy].append(finding)
    if not groups and not explained:
        return []
    lines = [f"{heading}:"]
    for number, findings in enumerate(list(groups.values())[:SENTENCES], 1):
        lines += _group(number, findings)
    if len(groups) > SENTENCES:
        lines.append(f"  and {len(groups) - SENTENCES} more kinds: all are in the file that verify_report names.")
    if explained:
        follow = "1 more follows" if explained == 1 else f"{explained} more follow"
        lines.append(f"  {follow} from {'these' if verdict == FAILED else 'what failed'}.")
    return ["\n".join(lines)]


def _group(number: int, findings: Sequence[Finding]) -> list[str]:
    first = findings[0]
    pairs = [whom(finding) for finding in findings[:PAIRS]]
    if len(findings) > PAIRS:
        pairs.append(f"and {len(findings) - PAIRS} more")
    alike = len({(finding.expected, finding.found) for finding in findings}) == 1
    found: dict[str, str] = {}  # what was found -> by whom first
    for finding in findings:
        found.setdefault(finding.found, "" if alike else f" ({whom(finding)})")
    rows = [
        (f"{number:>3}. ", f"{TITLES[first.check]}: {', '.join(pairs)}"),
        ("     expected: ", first.expected + found[first.found]),
        *(("     found:    ", text + of) for text, of in list(found.items())[:PAIRS]),
        ("     cause:    ", first.cause),
        ("     remedy:   ", first.remedy),
    ]
    return [
        textwrap.fill(
            text,
            WIDTH,
            initial_indent=label,
            subsequent_indent=" " * len(label),
            break_long_words=False,
            break_on_hyphens=False,
        )
        for label, text in rows
        if text
    ]


def whom(finding: Finding) -> str:
    """The computer, or the pair, of a finding."""
    return finding.observer if finding.observer == finding.target else f"{finding.observer} -> {finding.target}"


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


def document(summary: Summary, findings: Sequence[Finding]) -> dict[str, Any]:
    """All findings as plain data."""
    return {
        "computers": list(summary.computers),
        "verdict": FAILED if summary.number(FAILED) else OK,
        "checks": counts(summary),
        "findings": [finding._asdict() for finding in findings],
    }


def counts(summary: Summary) -> list[dict[str, Any]]:
    """One entry per check that was made: its id, its title, and how many findings have each verdict."""
    return [
        {
            "check": check.id,
            "title": check.title,
            **{verdict: summary.counts[check.id][verdict] for verdict in VERDICTS},
        }
        for check in CHECKS
        if check.id in summary.counts
    ]
