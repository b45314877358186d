# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The check of the time that a computer follows, if the fleet has a source of time."""

from __future__ import annotations

from ..._base.sentences import shorten_list
from ..._verify.checks.discovery_nodes import rate_offset
from ..._verify.checks.engine import FAILED, OK, Check, Judgement
from ..._verify.checks.hooks import CheckHooks
from ..._verify.context import needs
from ..._verify.context.check_context import CheckContext
from ..._verify.context.needs import Components, make_components
from ..._verify.observe.observations import TimeSource
from .model import Clock


def _is_asked(context: CheckContext) -> bool:
    return (
        context.observer.is_probed
        and Clock.find(context.observer.plan) is not None
        and context.probe.clock.answers is not None
    )


def _find_own(context: CheckContext, clock: Clock) -> TimeSource | None:
    """Return the planned source, if the computer asks it."""
    return next((source for source in context.probe.clock.sources if source.address == str(clock.server)), None)


def _list_strange(context: CheckContext, clock: Clock) -> list[str]:
    """List the addresses that the clock follows instead of the planned one."""
    followed = [source.address for source in context.probe.clock.sources if source.selected]
    others = [address for address in followed if address != str(clock.server)]
    return others or ([] if _find_own(context, clock) else ["nobody"])


def list_components(context: CheckContext, computer: str) -> Components:
    """List the components that keep a computer from the fleet's time, if it has one."""
    plan = context.fleet.computers.get(computer)
    clock = Clock.find(plan) if plan else None
    if clock is None:
        return frozenset()
    return make_components("time_source", computer, "none", "wrong") | make_components(
        "time_source", clock.source, "none", "mute"
    )


def _silence(context: CheckContext) -> Components:
    """The source does not answer: its chrony, or something on the way."""
    clock = Clock.find(context.observer.plan)
    if clock is None:
        return frozenset()
    return make_components("time_source", clock.source, "none", "mute") | needs.way(
        context, context.observer.name, clock.source
    )


def _needs(context: CheckContext) -> Components:
    """A source that runs says nothing of its answers."""
    clock, name = Clock.find(context.observer.plan), context.observer.name
    if clock is None or clock.server is None:
        return make_components("time_source", name, "none")
    return list_components(context, name) | _silence(context)


@Check(
    title="its clock follows the source of the fleet's time",
    when=_is_asked,
    of_site=True,
    needs=_needs,
    suspects=_silence,
)
def _judge_time_source(context: CheckContext) -> Judgement | None:
    clock, name = Clock.find(context.observer.plan), context.observer.name
    if clock is None:
        return None
    expected = f"it follows {clock.source} ({clock.server})" if clock.server else "a time service that answers"
    if not context.probe.clock.answers:
        return Judgement(FAILED, expected, "no time service answers", make_components("time_source", name, "none"))
    if clock.server is None:
        return Judgement(OK, expected, context.probe.clock.service)
    strange, own = _list_strange(context, clock), _find_own(context, clock)
    if strange or own is None:
        components = make_components("time_source", name, "wrong", what=shorten_list(strange))
        return Judgement(FAILED, expected, f"it follows {shorten_list(strange)}", components)
    if not own.reachable or not own.selected:
        return Judgement(
            FAILED, expected, "it does not answer" if not own.reachable else "it answers, and is not followed"
        )
    found = "it does" if own.offset_s is None else f"{own.offset_s:+.4f} s"
    return Judgement(rate_offset(abs(own.offset_s or 0.0)), expected, found, make_components("clock", name, "off"))


HOOKS = CheckHooks(
    checks=(_judge_time_source,), after="network", offset_checks=("time_source",), list_clock_components=list_components
)
