# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Computers that the collection did not set up: the nodes of others, and the checks that do not hold there."""

from __future__ import annotations

from collections.abc import Callable

from .._case.case import Case
from .._case.needs import Parts, make_parts
from .._case.parts import ANY
from .engine import COMPUTER, FAILED, OK, UNKNOWN, WARNING, Check, Judgement

NOT_OURS = Judgement(UNKNOWN, "what site.yml sets up", "the collection has not set this computer up")

Judge = Callable[[Case], Judgement | None]


def guard_judge(judge: Judge, looked: Callable[[Case], bool]) -> Judge:
    """Return the judge of a check on the work of site.yml. Where site.yml has not run, the result is unknown if `looked` is true."""

    def judge_computer(case: Case) -> Judgement | None:
        if not case.is_set_up_by_hand:
            return judge(case)
        return NOT_OURS if looked(case) else None

    return judge_computer


def guard_evidence(evidence: Callable[[Case], Parts]) -> Callable[[Case], Parts]:
    """Return the evidence of such a check. Where site.yml has not run, that is the only evidence."""
    return lambda case: (
        make_parts("set_up", case.observer.name, "by_hand") if case.is_set_up_by_hand else evidence(case)
    )


def _judge_set_up(case: Case) -> Judgement | None:
    return Judgement(FAILED, "site.yml has run", "no record of the collection") if case.was_never_set_up else None


SET_UP = Check(
    id="set_up",
    title="site.yml has run",
    scope=COMPUTER,
    judge=_judge_set_up,
    about="computer",
    expected="the collection has its records there; listed only where it has none",
    evidence=lambda case: make_parts("set_up", ANY if case.was_none_set_up else case.observer.name, "never"),
)


def _judge_conflicts(case: Case) -> Judgement | None:
    found = case.observer.seen.found
    if found is None:
        return None
    other = [text.removeprefix(f"{case.observer.name}: ") for text in (*found.runs, *found.noted)]
    return Judgement(WARNING if other else OK, "nothing that site.yml would refuse", " ".join(other) or "nothing")


def _conflict_evidence(case: Case) -> Parts:
    found = case.observer.seen.found
    return make_parts("set_up", case.observer.name, "others" if found is not None and found.runs else "refused")


AS_PLANNED = Check(
    id="as_planned",
    title="nothing stands against the plan",
    scope=COMPUTER,
    judge=_judge_conflicts,
    about="computer",
    expected="nobody else holds the ports of its services, and site.yml would refuse nothing else there (warning)",
    evidence=_conflict_evidence,
)
