# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Computers that the collection did not set up: the nodes of others, and the checks that do not hold there."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps

from .._case.case import Case
from .._case.needs import make_parts
from .._case.parts import ANY
from .engine import FAILED, UNKNOWN, WARNING, Check, Judge, Judgement, judge_fault


def guard(looked: Callable[[Case], bool]) -> Callable[[Judge], Judge]:
    """Decorate the judge of a check on the work of site.yml. Where that has not run, the result is unknown if `looked` is true."""

    def guard_judge(judge: Judge) -> Judge:
        @wraps(judge)
        def judge_ours(case: Case) -> Judgement | None:
            if not case.is_set_up_by_hand:
                return judge(case)
            by_hand = make_parts("set_up", case.observer.name, "by_hand")
            found = "the collection has not set this computer up"
            return Judgement(UNKNOWN, "what site.yml sets up", found, by_hand) if looked(case) else None

        return judge_ours

    return guard_judge


@Check(
    title="site.yml has run",
)
def _judge_set_up(case: Case) -> Judgement | None:
    if not case.was_never_set_up:
        return None
    never = make_parts("set_up", ANY if case.was_none_set_up else case.observer.name, "never")
    return Judgement(FAILED, "site.yml has run", "no record of the collection", never)


@Check(
    title="nothing stands against the plan",
)
def _judge_as_planned(case: Case) -> Judgement | None:
    found = case.observer.seen.found
    if found is None:
        return None
    other = [text.removeprefix(f"{case.observer.name}: ") for text in (*found.runs, *found.noted)]
    parts = make_parts("set_up", case.observer.name, "others" if found.runs else "refused")
    return judge_fault(WARNING, "nothing that site.yml would refuse", " ".join(other), "nothing", parts)
