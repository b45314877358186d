# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Computers that the collection did not set up: the nodes of others, and the checks that do not hold there."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from .._case.case import Case
from .._case.needs import Parts, make_parts
from .._case.parts import ANY
from .engine import FAILED, OK, UNKNOWN, WARNING, Check, Judgement

NOT_OURS = Judgement(UNKNOWN, "what site.yml sets up", "the collection has not set this computer up")


def guard(looked: Callable[[Case], bool]) -> Callable[[Check], Check]:
    """Decorate a check on the work of site.yml. Where that has not run, the result is unknown if `looked` is true.

    Then that is the only evidence.
    """

    def guard_check(check: Check) -> Check:
        def judge(case: Case) -> Judgement | None:
            if not case.is_set_up_by_hand:
                return check.judge(case)
            return NOT_OURS if looked(case) else None

        def find_evidence(case: Case) -> Parts:
            by_hand = case.is_set_up_by_hand
            return make_parts("set_up", case.observer.name, "by_hand") if by_hand else check.evidence(case)

        return replace(check, judge=judge, evidence=find_evidence)

    return guard_check


@Check(
    title="site.yml has run",
    expected="the collection has its records there; listed only where it has none",
    evidence=lambda case: make_parts("set_up", ANY if case.was_none_set_up else case.observer.name, "never"),
)
def _judge_set_up(case: Case) -> Judgement | None:
    return Judgement(FAILED, "site.yml has run", "no record of the collection") if case.was_never_set_up else None


def _conflict_evidence(case: Case) -> Parts:
    found = case.observer.seen.found
    return make_parts("set_up", case.observer.name, "others" if found is not None and found.runs else "refused")


@Check(
    title="nothing stands against the plan",
    expected="nobody else holds the ports of its services, and site.yml would refuse nothing else there (warning)",
    evidence=_conflict_evidence,
)
def _judge_as_planned(case: Case) -> Judgement | None:
    found = case.observer.seen.found
    if found is None:
        return None
    other = [text.removeprefix(f"{case.observer.name}: ") for text in (*found.runs, *found.noted)]
    return Judgement(WARNING if other else OK, "nothing that site.yml would refuse", " ".join(other) or "nothing")
