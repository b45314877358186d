# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The reasons for a finding, as data: its evidence, the results that it explains, the rivals and the successes that cleared them."""

from __future__ import annotations

from dataclasses import dataclass

from ..trace.steps import PacketTrace

SEEN, LOCATED, INFERRED = "seen", "located", "inferred"
#: how a finding was shown
VALUE, BLOCKING_RULE, ERRNO, TRACE, INFERENCE = "value", "blocking rule", "errno", "packet trace", "inference"
#: the reasons that cleared a rival
SUCCESS, GOOD_VALUE, PASSING_RULES, PASSED_TRACE, OWN_FINDING = "success", "value", "rules", "packet trace", "finding"
#: or why it was not named, though nothing cleared it
FEWER, RARER, LESS = "explains fewer", "rarer", "explains less elsewhere"
EQUAL, OUTWEIGHED = "as likely", "outweighed"
CLEARED = (SUCCESS, GOOD_VALUE, PASSING_RULES, PASSED_TRACE, OWN_FINDING)


@dataclass(frozen=True)
class Evidence:
    """The evidence of a finding: a row, and all else that was known of it."""

    kind: str
    rule: str  # the decision rule
    check: str
    observer: str
    target: str
    expected: str
    found: str
    source: str = ""  # the file with the judge of the check
    detail: str = ""  # the rule of the packet filter, or the word of the errno
    trace: PacketTrace | None = None


@dataclass(frozen=True)
class ExplainedRows:
    """Rows of one check that a finding explains, and the decision rule that gave them to it."""

    check: str
    rule: str
    rows: int


@dataclass(frozen=True)
class WeighedRival:
    """Another component that may be the reason of the same rows, and why it is not the finding."""

    id: str
    kind: str
    mode: str
    place: str
    what: str
    rows: int  # that it would explain, of those that were looked at
    cost: float
    cleared: bool
    reason: str  # a word of above
    check: str = ""  # the success that clears it
    observer: str = ""
    target: str = ""


@dataclass(frozen=True)
class Because:
    """The reasons for a finding."""

    rule: str  # the decision rule that won
    title: str  # its words
    place: int  # its place in the table, from 1
    rules: int  # rows of the table
    certainty: str
    cost: float  # of the component
    looked_at: int  # rows of the finding of which rivals were asked
    shown_by: tuple[Evidence, ...]
    explains: tuple[ExplainedRows, ...]
    rivals: tuple[WeighedRival, ...]
