# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""What the collection did not set up: who runs the nodes then, and what cannot be judged there."""

from __future__ import annotations

from collections.abc import Callable

from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.case import Case
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.engine import (
    COMPUTER,
    OK,
    UNKNOWN,
    WARNING,
    Cause,
    Check,
    Documented,
    Judgement,
)

NOT_OURS = Judgement(UNKNOWN, "what site.yml sets up", "the collection has not set this computer up")

Judge = Callable[[Case], Judgement | None]


def of_site_yml(judge: Judge, looked: Callable[[Case], bool]) -> Judge:
    """Return the judge of a check on what site.yml makes: where it has not run, and yet `looked` is true, nothing is judged."""

    def judged(case: Case) -> Judgement | None:
        if not case.by_hand:
            return judge(case)
        return NOT_OURS if looked(case) else None

    return judged


def _by_hand(case: Case) -> bool:
    return case.by_hand


BY_HAND = Cause(
    "it was set up by hand, or by something else",
    "nothing, if that is wanted: the other checks say if the fleet talks; else run site.yml",
    when=_by_hand,
)


def _other_nodes(case: Case) -> bool:
    found = case.observer.seen.found
    return found is not None and bool(found.runs)


def _as_planned(case: Case) -> Judgement | None:
    found = case.observer.seen.found
    if found is None:
        return None
    other = [text.removeprefix(f"{case.observer.name}: ") for text in (*found.runs, *found.noted)]
    return Judgement(WARNING if other else OK, "nothing that site.yml would refuse", " ".join(other) or "nothing")


AS_PLANNED = Check(
    id="as_planned",
    title="nothing stands against the plan",
    scope=COMPUTER,
    judge=_as_planned,
    documented=Documented(
        "computer",
        "nobody else holds the ports of its services, and site.yml would refuse nothing else there (warning)",
    ),
    causes=(
        Cause(
            "the nodes were started by hand, or by something else; they are judged as they are",
            "nothing, if that is wanted; else stop them on {observer}, and run site.yml",
            when=_other_nodes,
        ),
        Cause("site.yml would refuse this computer, before it changes anything", "do what the sentences say"),
    ),
)

CHECKS = (AS_PLANNED,)
