# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Checks of the next boot: deviations from the plan that come with it. One check for each kind of component."""

from __future__ import annotations

from collections.abc import Callable

from ..context.check_context import CheckContext
from ..context.needs import join_components, make_components
from .engine import FAILED, WARNING, Check, Judgement, judge_fault


def _check(kind: str, title: str, planned: Callable[[CheckContext], bool], fine: str) -> Check:
    def has_plan(context: CheckContext) -> bool:
        # On a computer that the collection has yet to set up, one sentence for all kinds is enough.
        judged = context.observer.is_set_up or (kind == "unit" and context.is_set_up_by_hand)
        return context.observer.is_probed and planned(context) and judged

    def judge(context: CheckContext) -> Judgement:
        entries = [entry for entry in context.probe.next_boot if entry.kind == kind]
        states = "; ".join(f"{entry.name}: {entry.found}" for entry in entries)
        components = join_components(
            make_components("boot", context.observer.name, kind, what=entry.name) for entry in entries
        )
        return judge_fault(FAILED, entries[0].expected if entries else fine, states, fine, components)

    return Check(
        title=title,
        when=has_plan,
        of_site=True,
        needs=lambda context: make_components("boot", context.observer.name, kind),
        id=f"next_boot_{kind}",
        judge=judge,
    )


UNIT = _check(
    "unit",
    "services start at the next boot",
    lambda context: bool(context.observer.plan.services),
    "all enabled",
)
SYSCTL = _check(
    "sysctl",
    "kernel settings stay at the next boot",
    lambda context: bool(context.observer.plan.sysctl),
    "the planned values",
)
ROUTE = _check(
    "route",
    "routes stay at the next boot",
    lambda context: bool(context.observer.plan.routes),
    "the files of all routes",
)
NAMES = _check(
    "names",
    "/etc/hosts stays at the next boot",
    lambda context: not context.observer.plan.is_router,
    "nobody writes it anew",
)


@Check(
    title="nodes can start",
    needs=lambda context: make_components("ros", context.observer.name, "broken"),
)
def _judge_next_start(context: CheckContext) -> Judgement | None:
    found = context.observer.seen.found
    if found is None or context.observer.plan.is_router or (context.probe.ros_missing and not found.broken_ros):
        return None
    verdict = FAILED if context.observer.plan.is_master else WARNING
    broken = found.broken_ros.removeprefix(f"{context.observer.name}: ")
    components = make_components("ros", context.observer.name, "broken")
    return judge_fault(verdict, "nodes that are started now find their modules", broken, "as planned", components)
