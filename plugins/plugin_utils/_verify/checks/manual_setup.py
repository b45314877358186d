# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Computers that the collection did not set up, and foreign nodes."""

from __future__ import annotations

from ..._base.sentences import shorten_list
from ..components.component import ANY
from ..context.check_context import CheckContext
from ..context.needs import make_components
from .engine import FAILED, WARNING, Check, Judgement, judge_fault


@Check(
    title="site.yml has run",
    when=lambda context: context.was_never_set_up,
)
def _judge_set_up(context: CheckContext) -> Judgement:
    never = make_components("set_up", ANY if context.was_none_set_up else context.observer.name, "never")
    return Judgement(FAILED, "site.yml has run", "no record of the collection", never)


@Check(
    title="nothing conflicts with the plan",
)
def _judge_as_planned(context: CheckContext) -> Judgement | None:
    found = context.observer.seen.found
    if found is None:
        return None
    other = [text.removeprefix(f"{context.observer.name}: ") for text in (*found.runs, *found.noted)]
    running = shorten_list(text.removeprefix(f"{context.observer.name}: ").rstrip(".") for text in found.runs)
    components = make_components("set_up", context.observer.name, "others" if found.runs else "refused", what=running)
    return judge_fault(WARNING, "nothing that site.yml would refuse", " ".join(other), "nothing", components)


@Check(
    title="no interface leads into another robot's network",
    when=lambda context: context.observer.seen.found is not None,
    needs=lambda context: make_components("interface", context.observer.name, "overlap"),
)
def _judge_overlaps(context: CheckContext) -> Judgement:
    found = context.observer.seen.found
    named = shorten_list(found.overlaps, 4) if found else ""
    components = make_components("interface", context.observer.name, "overlap", what=named)
    return judge_fault(WARNING, "no address or route in the network of another robot", named, "none", components)
