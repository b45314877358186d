# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The reasons for a finding, in ten lines for a person: plain data of a document in, labelled lines out. Pure."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from ..._base.plain_text import plain
from ..._base.sentences import shorten_list
from ..checks.table import TITLES
from . import evidence
from .rules import BY_ID

LEAST = 20  # columns of a text
MOST = 10  # lines of an explanation
SHOWN = 2  # rows that have shown it
NAMED = 4  # checks of explained rows
ALL = "all"
TABLE, RULES = "_faults", "diagnose/rules.py"
PLACES = {"node": "context/announcements.py"}  # the kind of a component -> the file that has chosen its mode and place
REASONS: Mapping[str, str] = {
    evidence.SUCCESS: "cleared by a success: {row}",
    evidence.GOOD_VALUE: "cleared by a value: it was read there, and is as planned",
    evidence.PASSING_RULES: "cleared by rules: those that were read there let it pass",
    evidence.PASSED_TRACE: "cleared by the packet trace: the packets were seen to pass it",
    evidence.OWN_FINDING: "it is a finding of its own",
    evidence.FEWER: "not cleared: it explains {rows} of {looked_at} rows",
    evidence.RARER: "not cleared: rarer (cost {cost:g} against {own:g})",
    evidence.LESS: "not cleared: of all that failed, it explains less",
    evidence.EQUAL: "not cleared: as likely, so both are named",
    evidence.OUTWEIGHED: "not cleared: the packet trace outweighs it",
}


class UnknownFinding(ValueError):
    """An option names no finding. The message names the expected form."""


def choose_findings(option: str, count: int) -> list[int]:
    """Read which findings are to be explained: none, numbers from 1 with commas, or all. Raises UnknownFinding."""
    words = [word.strip() for word in option.split(",") if word.strip()]
    if words == [ALL]:
        return list(range(1, count + 1))
    numbers = [int(word) if word.isdecimal() and len(word) < 5 else 0 for word in words]
    if not all(0 < number <= count for number in numbers):
        numbered = f"a number from 1 to {count}, several with commas" if count else "nothing, since there is no finding"
        raise UnknownFinding(f"explain is {plain(option, 80)}; expected {numbered}, or all.")
    return numbers


def write_explanation(number: int, entry: Mapping[str, Any], width: int) -> list[str]:
    """Write at most ten lines, each as wide as the terminal, about the finding with this number."""
    lines = [(f"Finding {number}, {entry['id']}:", f"{entry['sentence']} ({entry['verdict']})")]
    lines += [(f"  {label:<11}", text) for label, text in list_lines(entry)]
    return [f"{label} {plain(text, max(width - len(label) - 1, LEAST))}" for label, text in lines[:MOST]]


def list_lines(entry: Mapping[str, Any]) -> list[tuple[str, str]]:
    """List at most nine lines, each with a label."""
    because = entry["because"]
    if not because:
        return [("", "only the first findings are explained")]
    first = [*_list_decision(because), *_list_evidence(because), ("explains:", _count_rows(because["explains"]))]
    last = [("wrong?", _name_files(entry))]
    rivals = list(_list_rivals(because))[: MOST - 1 - len(first) - len(last)]
    return [*first, *rivals, *last]


def _list_decision(because: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    yield (
        "decided by:",
        f"rule {because['place']} of {because['rules']}, {because['rule']}: {because['title']} ({because['certainty']})",
    )


def _list_evidence(because: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield the rows that have shown it, then a rule of a packet filter, an errno or the trace."""
    shown = because["shown_by"]
    label = "shown by:" if because["certainty"] != evidence.INFERRED else "such as:"
    for one in shown[:SHOWN]:
        yield label, f"{_name_row(one)}: expected {one['expected']}, found {one['found']}"
    for one in shown[:1]:
        if one["detail"]:
            yield f"{one['kind'].split()[-1]}:", one["detail"]
        if one["trace"]:
            yield "trace:", write_trace(one["trace"])


def write_trace(trace: Mapping[str, Any]) -> str:
    """Write a packet trace on one line: each computer with its steps."""
    hops = (
        f"{hop['computer']}: " + ", ".join(f"{step['action']} {step['detail']}" for step in hop["steps"])
        for hop in trace["hops"]
    )
    return f"{trace['packets']}: " + " > ".join(hops)


def _count_rows(explained: Sequence[Mapping[str, Any]]) -> str:
    total = sum(one["rows"] for one in explained)
    names = [f"{TITLES.get(one['check'], one['check'])} ({one['rows']}, {one['rule']})" for one in explained]
    return f"{total} rows: {shorten_list(names, NAMED)}"


def _list_rivals(because: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    for one in because["rivals"]:
        words = {"row": _name_row(one), "looked_at": because["looked_at"], "own": because["cost"]}
        reason = REASONS.get(one["reason"], one["reason"]).format(**{**one, **words})
        what = f" ({one['what']})" if one["what"] else ""
        yield "rival:", f"{one['id']}, {one['kind']} {one['mode']} of {one['place']}{what}: {reason}"


def _name_row(row: Mapping[str, Any]) -> str:
    pair = row["observer"] if row["observer"] == row["target"] else f"{row['observer']} -> {row['target']}"
    return f"{TITLES.get(row['check'], row['check'])}, {pair}"


def _name_files(entry: Mapping[str, Any]) -> str:
    """Name the files that decide, for who corrects a finding: first those of the rule, then the judges of what has shown it."""
    rule = BY_ID.get(entry["because"]["rule"])
    judges = (one["source"] for one in entry["because"]["shown_by"] if one["source"])
    chosen = filter(None, [PLACES.get(entry["kind"])])
    files = dict.fromkeys((*chosen, *(rule.decides if rule else ()), *judges))
    return f"see {', '.join(files) or 'checks'}, {entry['id']} in {TABLE}, and {RULES}"
