# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The report for the terminal: table, matrix, findings. Pure: a judgement in, text out."""

from __future__ import annotations

import textwrap
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import count, islice
from typing import Any

from ..._base.plain_text import plain
from ..._base.sentences import join_causes, shorten_list
from ..._faults.fault import PAGES, Advices
from ..checks.engine import FAILED, OK, UNKNOWN, VERDICTS, WARNING, Row
from ..checks.table import CHECKS, TITLES
from ..diagnose.diagnosis import Diagnosis, Finding
from .nodes import HEADINGS as NODE_HEADINGS
from .nodes import ROWS, describe_nodes, list_cells
from .summary import Summary, is_small, write_result
from .traffic import HEADINGS, describe_measurement, list_dearest

WIDTH = 120
CELL = 8  # columns of a cell of the matrix, if there is room
SENTENCES = 20  # findings that are printed; all are in the file
REMARKS = 10  # that are printed; all are in the file
PAIRS = 4  # pairs, names or checks that are named in a finding
WORST = (FAILED, UNKNOWN, WARNING, OK)


def render(
    summary: Summary,
    diagnosis: Diagnosis,
    width: int = WIDTH,
    everything: bool = True,
    traffic: Mapping[str, Any] | None = None,
    nodes: Mapping[str, Any] | None = None,
    remarks: Sequence[str] = (),
) -> str:
    """Return the report, of this width if names allow it. Without `everything` it has no table and no matrix."""
    components = [_title(summary), _table(summary)] if everything else [_title(summary)]
    if everything and len(summary.computers) > 1 and is_small(summary.computers):
        components.append(_matrix(summary))
    numbers = count(1)
    if diagnosis.looked_at < diagnosis.total:
        components.append(f"Explained are {diagnosis.looked_at} of {diagnosis.total} results that are not as expected.")
    for verdict, heading in ((FAILED, "Findings"), (WARNING, "Warnings"), (UNKNOWN, "Not judged")):
        components += _findings(
            [entry for entry in diagnosis.findings if entry.verdict == verdict], heading, numbers, width
        )
    components += (
        [f"The meaning of ids such as {diagnosis.findings[0].component.fault.id}:\n  {PAGES}"]
        if diagnosis.findings
        else []
    )
    components += _format_unexplained(diagnosis.unexplained, width)
    components += _format_nodes(nodes, width) if nodes else []
    components += _format_traffic(traffic, width) if traffic else []
    components += _format_remarks(remarks, width)
    components.append(_wrap("", write_result(summary, diagnosis), width))
    return "\n\n".join(components)


def _title(summary: Summary) -> str:
    if len(summary.computers) == summary.fleet:
        title = f"VERIFICATION of {summary.fleet} computers"
    else:
        title = f"VERIFICATION of {len(summary.computers)} of {summary.fleet} computers; the others are not in this run"
    return title + _sample(summary)


def _sample(summary: Summary) -> str:
    """Return how many pairs of a large fleet were tried; empty if it was all."""
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
    """Return the matrix: rows observe columns. The diagonal has a computer's checks of itself."""
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
    numbered = list(zip(findings, numbers, strict=False))  # as in the file, also behind those that are not printed
    for entry, number in numbered[:SENTENCES]:
        lines += [_wrap(label.format(number=number), text, width) for label, text in _finding(entry) if text]
    if len(findings) > SENTENCES:
        lines.append(f"  and {len(findings) - SENTENCES} more: all are in the file that verify_report names.")
    return ["\n".join(lines)]


def _finding(entry: Finding) -> Iterator[tuple[str, str]]:
    """Yield the lines of a finding: (label, text). Those without a text are not printed."""
    causes = [component.sentence() for component in entry.candidates] if entry.rivals else [entry.sentence()]
    named = [f"{cause} [{component.fault.id}]" for cause, component in zip(causes, entry.candidates, strict=True)]
    yield "{number:>3}. ", join_causes(named)
    if entry.proof:
        yield "     seen:     ", _describe_rows(entry.proof)
        yield "     follows:  ", _count_checks(row.check for row in entry.rows)
    else:
        yield "     for it:   ", _count_checks(row.check for row in entry.rows) + " fail" + _example(entry.rows)
        if entry.passed:
            yield "     besides:  ", "in the same pairs these succeed: " + _count_checks(entry.passed)
    for end in entry.followed:
        if end.words != entry.component.what:
            yield "     followed: ", end.words
    yield "     since:    ", entry.since
    yield "     behind:   ", _name_unexamined(entry)
    yield from _list_advices("do:", entry.do)
    yield from _list_advices("look:", entry.look)


def _list_advices(word: str, advices: Advices) -> Iterator[tuple[str, str]]:
    """Yield a line for each advice, and one for its effect: a command can be pasted as it is."""
    lines = [line for one in advices for line in (one.order, f"({one.effect})" if one.effect else "") if line]
    for number, line in enumerate(lines):
        yield f"     {'' if number else word:<10}", line


def _example(rows: Sequence[Row]) -> str:
    """Return the first row as an example; empty if it has no value."""
    return f"; such as {_pair(rows[0])}: {rows[0].found}" if rows and rows[0].found else ""


def _name_unexamined(entry: Finding) -> str:
    """Return the computers that could not be examined because of a finding."""
    names = dict.fromkeys(row.observer for row in entry.rows if row.check == "reachable")
    others = [name for name in names if name not in entry.component.places]
    return f"not examined: {shorten_list(others, PAIRS)}" if others else ""


def _describe_rows(rows: Sequence[Row]) -> str:
    """Return the first check of these rows with its pairs, and the found value of the first one."""
    first = rows[0]
    pairs = dict.fromkeys(_pair(row) for row in rows if row.check == first.check)
    return f"{TITLES[first.check]}: {shorten_list(pairs, PAIRS)}: expected {first.expected}, found {first.found}"


def _count_checks(checks: Iterable[str]) -> str:
    """Return titles of checks, each with its number."""
    names = [f"{TITLES[check]} ({number})" for check, number in Counter(checks).most_common()]
    return shorten_list(names, PAIRS, "other checks")


def _format_unexplained(rows: Sequence[Row], width: int) -> list[str]:
    """Return the rows that no finding explains, one line for each check."""
    if not rows:
        return []
    lines = ["Not explained (lost packets, or something that comes and goes: run it again):"]
    groups: dict[str, list[Row]] = defaultdict(list)
    for row in rows:
        groups[row.check].append(row)
    lines += [_wrap("   -  ", _describe_rows(group), width) for group in groups.values()]
    return ["\n".join(lines)]


def _format_remarks(remarks: Sequence[str], width: int) -> list[str]:
    """Return the warnings of preflight, of which nothing here has failed."""
    if not remarks:
        return []
    lines = ["Remarks on the computers, which fail nothing:"]
    lines += [_wrap("   -  ", text, width) for text in remarks[:REMARKS]]
    if len(remarks) > REMARKS:
        lines.append(f"  and {len(remarks) - REMARKS} more: all are in the file that verify_report names.")
    return ["\n".join(lines)]


def _format_nodes(nodes: Mapping[str, Any], width: int) -> list[str]:
    """Return the number of nodes in a sentence, and a table of those with which something is wrong."""
    sentence = describe_nodes(nodes)
    if not sentence:
        return []
    lines = [_wrap("Nodes: ", sentence, width)]
    rows = list(islice(list_cells(nodes), ROWS))
    if rows:
        room = (width - 2 - 2 * len(NODE_HEADINGS)) // 4  # columns of the longest cell
        table = [NODE_HEADINGS, *(tuple(plain(cell, room) for cell in row) for row in rows)]
        widths = [max(map(len, column)) for column in zip(*table, strict=True)]
        lines += [
            ("  " + "  ".join(f"{cell:<{size}}" for cell, size in zip(cells, widths, strict=True))).rstrip()
            for cells in table
        ]
    more = len(nodes["odd"]) + nodes["left_out"] - len(rows)
    return ["\n".join([*lines, *([f"  and {more} more: see the file that verify_report names."] if more else [])])]


def _format_traffic(traffic: Mapping[str, Any], width: int) -> list[str]:
    """Return the table of the topics that cost most between robots; nothing if nothing does."""
    rows = list_dearest(traffic)
    if not rows:
        return []
    room = (width - 2 - 4 * 2 - 10 - 10) // 3  # columns of a cell with names: next to it are gaps and two numbers
    table = [HEADINGS, *([*(plain(cell, room) for cell in row[:3]), *row[3:]] for row in rows)]
    widths = [max(map(len, column)) for column in zip(*table, strict=True)]
    lines = ["What costs most between robots:", _wrap("  ", f"{describe_measurement(traffic)}.", width)]
    for cells in table:
        names = [f"{cell:<{size}}" for cell, size in zip(cells[:3], widths, strict=False)]
        numbers = [f"{cell:>{size}}" for cell, size in zip(cells[3:], widths[3:], strict=True)]
        lines.append("  " + "  ".join(names + numbers))
    return ["\n".join(lines)]


def _wrap(label: str, text: str, width: int) -> str:
    """Wrap a text behind its label. A line that begins within a quotation begins with a quote."""
    lines, is_quotation = [], False
    for line in textwrap.wrap(text, max(width - len(label), 20), break_long_words=False, break_on_hyphens=False):
        lines.append(f'"{line}' if is_quotation else line)
        is_quotation ^= line.count('"') % 2 == 1
    return label + f"\n{' ' * len(label)}".join(lines)


def _pair(row: Row) -> str:
    """Return the pair of a row, or its one computer."""
    return row.observer if row.observer == row.target else f"{row.observer} -> {row.target}"
