# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Errors as evidence: from the outcome of a probe to the few components that may be the reason. Pure.

An errno of the sender's own kernel speaks of the sender (OWN). An ICMP error speaks of the computer that reports it, which may
be the sender, too (REPORTED). A refusal speaks of the target (REFUSED).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

from ..components.component import Component
from ..observe.observations import Ping
from ..observe.outcomes import Outcome
from . import needs
from .check_context import CheckContext
from .needs import Components, join_components, make_components
from .packet_filters import ROSCORE

_LIMITS = {
    Outcome.NO_FILE: "a process may not open more files",
    Outcome.NO_FILE_HERE: "the kernel opens no more files for anybody",
    Outcome.NO_MEMORY: "the kernel has no memory for sockets and packets",
}
#: errno of the sender -> the ways in which it may be broken, as (kind, mode, what); `{}` is the traffic. The likeliest one comes first.
OWN: Mapping[Outcome, tuple[tuple[str, str, str], ...]] = {
    Outcome.NO_LOCAL_PORT: (("computer", "ports", ""),),
    **{outcome: (("computer", "limit", words),) for outcome, words in _LIMITS.items()},
    Outcome.NOT_PERMITTED: tuple(("filter", mode, "") for mode in ("{} out", "{}", "all out", "all")),
    Outcome.CLOSED_ROUTE: (("route", "rule", ""), ("route", "closed", "")),
}


def list_own_components(outcome: Outcome, sender: str, traffic: str) -> list[Component]:
    """List the components that an errno of the sender's kernel leaves, the likeliest component first; nothing if it says nothing of the sender."""
    return [Component(kind, sender, mode.format(traffic), what) for kind, mode, what in OWN.get(outcome, ())]


def find_components(context: CheckContext, outcome: Outcome, traffic: str) -> Components:
    """Return the suspects that the outcome of a probe leaves; nothing if it says nothing. `traffic` is a word of TRAFFIC."""
    target = context.masters[0] if traffic == ROSCORE else context.target
    if own := list_own_components(outcome, context.observer.name, traffic):
        return frozenset(own)
    if outcome == Outcome.REFUSED and traffic in REFUSED:
        return REFUSED[traffic](target) | list_refusers(context, target, traffic)
    if outcome == Outcome.RESET and traffic in PROGRAMS:
        return make_components(PROGRAMS[traffic], target, "hung") | list_rejects(context, target, traffic)
    if outcome not in REPORTED or target not in context.ways.members:
        return frozenset()
    return _find_reported_components(context, outcome, target, traffic)


def _find_reported_components(context: CheckContext, outcome: Outcome, target: str, traffic: str) -> Components:
    """Return the suspects that are left of an unreachable target, as the ping of the same pair has its reporter."""
    ping = (context.observer.members[target].ping_address if target in context.observer.members else None) or Ping()
    if ping.ok or (
        ping.outcome == Outcome.PROHIBITED and outcome != ping.outcome
    ):  # the way is good, and something rejects this kind
        return list_rejects(context, target, traffic)
    if ping.outcome != outcome and target != context.observer.name:  # a socket of TCP shows no reporter
        return frozenset()
    if not ping.reporter:
        return _list_lost_routes(context, target)
    return REPORTED[outcome](context, context.ways.name_at(ping.reporter), target)


PROGRAMS = {ROSCORE: "roscore", "rpc": "discovery"}  # traffic -> the program that it asks
REFUSED: Mapping[str, Callable[[str], Components]] = {
    ROSCORE: lambda target: make_components("roscore", target, "dead"),
    "rpc": lambda target: (
        make_components("discovery", target, "dead", "port") | make_components("roscore", target, "dead")
    ),
}


def list_refusers(context: CheckContext, target: str, traffic: str) -> Components:
    """List the components that may refuse in the target's place: another computer with its address, or a packet filter."""
    return needs.duplicates(context, context.observer.name, target) | list_rejects(context, target, traffic)


def list_rejects(context: CheckContext, target: str, traffic: str) -> Components:
    """List the packet filters that may report an error in the target's place."""
    if target == context.observer.name:
        return frozenset()
    between = context.ways.list_forwarders(context.observer.name, target)
    forwards = join_components(make_components("filter", gateway, "forward") for gateway in between)
    return forwards | needs.passes(context.observer.name, target, traffic)


def _list_lost_routes(context: CheckContext, target: str) -> Components:
    """The observer's own kernel has no route there, or one of the type unreachable."""
    name = context.observer.name
    return (
        needs.route_components(name, context.ways.network_of(target))
        | make_components("route", name, "closed", "rule")
        | make_components("interface", name, "address", "prefix")
        | needs.port_components(context, name)
        | make_components("link", name, "down", what=context.ways.list_links(name, target)[0][1])
    )


def _list_silent_neighbours(context: CheckContext, reporter: str, target: str) -> Components:
    """The reporter, which may be the observer, got no ARP answer from the next hop: the target, or a gateway."""
    if not reporter:
        return frozenset()
    crossed = context.ways.list_links(reporter, target)
    network = crossed[0][1]
    following = next((place for place, _network in crossed if place != reporter), target)
    found = needs.silent_components(reporter, following, network)
    for place in (reporter, following):
        found |= make_components("interface", place, "address", "prefix") | make_components(
            "neighbour", place, "mute", "filter"
        )
        found |= needs.port_components(context, place)
    beyond = context.ways.network_of(target)
    if not context.ways.is_in(reporter, beyond):  # or it has looked for the target in a network of its own
        found |= needs.route_components(reporter, beyond)
    return found


#: ICMP error -> the components of the computer that reports it, by its name, and of the target
REPORTED: Mapping[Outcome, Callable[[CheckContext, str, str], Components]] = {
    Outcome.HOST_UNREACHABLE: _list_silent_neighbours,
    Outcome.NETWORK_UNREACHABLE: lambda context, reporter, target: make_components(
        "route", reporter, "missing", what=context.ways.network_of(target)
    ),
    Outcome.TIME_EXCEEDED: lambda context, reporter, target: make_components(
        "route", reporter, "circle", what=context.ways.network_of(target)
    ),
    Outcome.PROHIBITED: lambda context, reporter, target: (
        make_components("filter", reporter or target, "forward") | needs.passes(context.observer.name, target, "icmp")
    ),
}
