# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Check of the relay: topics and services that cross by other names, or at a rate."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from ..._base.sentences import shorten_list
from ..._inventory.filters import matches
from ..._inventory.flows import find_inner_name, find_outer_name, list_names
from ..components.component import Component
from ..context import needs
from ..context.check_context import CheckContext
from ..context.needs import Components, join_components, make_components
from ..context.registrations import RELAY, TEST_NODES
from ..observe.observations import CrossingTopic, ServiceState
from ..observe.outcomes import Outcome
from .engine import FAILED, MASTER, Check, Judgement, judge_fault

DIAGNOSTICS = "/diagnostics"  # the relay has something to say itself
STATIC = "/tf_static"  # by which it says how the frames of robots hang together
NAMED = 4  # topics and services that a finding names
KINDS = {"publisher": "topics", "service": "services"}  # of registrations -> in a channel


def _list_channels(context: CheckContext) -> list[Mapping[str, Any]]:
    """List the channels of the observer to the target's robot."""
    plan = context.observer.plan
    return [entry for entry in (plan.relay or {}).get("channels", ()) if entry["peer"] == context.robots[1]]


def _find_names(context: CheckContext, kind: str, name: str) -> Iterator[str]:
    """Yield the observer's name of a topic or service of the target's robot; nothing if it does not cross."""
    for channel in _list_channels(context):
        inner = find_inner_name(channel, name) if channel["inner"] else name
        if inner is not None and matches(list_names(channel, KINDS[kind], given=False), inner):
            yield inner if channel["inner"] else find_outer_name(channel, inner)


def _list_roots(context: CheckContext) -> set[tuple[str, str]]:
    """List the topics that the target's relay itself publishes for the observer: the transforms between its robot's frames and others."""
    return {
        ("publisher", find_outer_name(channel, STATIC))
        for channel in _list_channels(context)
        if channel["world"] and not channel["inner"] and matches(channel["topics"], STATIC)
    }


def _find_wrong(context: CheckContext) -> tuple[list[str], list[str]] | None:
    """Find the names that the observer's relay lacks, and those without an owner; None if one roscore is not known."""
    robots = context.state.exchanges.robots
    own, its = context.robots
    if own not in robots or its not in robots:
        return None
    mine, there = _list_names(context, own, relay=False), _list_names(context, own, relay=True)
    due, tests = _list_due(context, tests=False) | _list_roots(context), _list_due(context, tests=True)
    # An own service is never replaced.
    missing = {entry for entry in due - there if entry[0] == "publisher" or entry not in mine}
    more = {entry for entry in there - due - tests if _is_of(context, *entry)}
    return sorted(name for _kind, name in missing), sorted(name for _kind, name in more)


def _list_due(context: CheckContext, *, tests: bool) -> set[tuple[str, str]]:
    """List kind and name here of the crossing topics and services of the target's own nodes: of those of the verification, or of the others."""
    return {
        (item.kind, name)
        for item in context.state.exchanges.robots[context.robots[1]].own
        if item.kind in KINDS and item.node != RELAY and item.node.startswith(TEST_NODES) is tests
        for name in _find_names(context, item.kind, item.name)
    }


def _list_names(context: CheckContext, robot: str, *, relay: bool) -> set[tuple[str, str]]:
    """List kind and name of the registrations of a robot's relay in its roscore, or of those of its other nodes."""
    return {
        (item.kind, item.name)
        for item in context.state.exchanges.robots[robot].own
        if item.kind in KINDS and (item.node == RELAY) is relay and not item.node.startswith(TEST_NODES)
    }


def _is_of(context: CheckContext, kind: str, name: str) -> bool:
    """Return True if the registrations of the observer's relay can only be of the target's robot: of no other peer, or by its namespace."""
    channels = (context.observer.plan.relay or {}).get("channels", ())
    if len({entry["peer"] for entry in channels}) == 1:
        return kind == "service" or name != DIAGNOSTICS
    names = [
        find_outer_name(channel, topic)
        for channel in _list_channels(context)
        for topic in list_names(channel, KINDS[kind], given=False)
        if channel["as"] and not channel["inner"]
    ]
    return matches(names, name)


_WRITTEN = "master_relay"  # the node whose parameters are compared
UNIT = "multimaster-relay.service"


def find_broken_relay(context: CheckContext, *computers: str) -> Components:
    """Find the faults of the relays of some computers themselves: topics that do not cross follow from them."""
    components: Components = frozenset()
    for name in computers:
        computer = context.run.get(name)
        if computer is None or not computer.is_probed:
            continue
        for entry in computer.probe.services:
            if entry.unit == UNIT and entry.active_state and entry.active_state != "active":
                components |= make_components("service", name, find_mode(entry), what=UNIT)
            elif entry.unit == UNIT and entry.stopped:
                components |= make_components("service", name, "stopped", what=UNIT)
        differing = [one for one in computer.probe.parameters.differing if one.node == _WRITTEN]
        components |= join_components(
            make_components("relay", name, "configuration", what=f"{one.name} is {one.found}") for one in differing
        )
    return components


def find_mode(entry: ServiceState) -> str:
    """Return the mode of the component of a service that is not active."""
    if entry.load_state == "not-found":
        return "missing"
    return "looping" if entry.active_state == "activating" and entry.restarts else "down"


def _suspects(context: CheckContext) -> Components:
    own, its = context.masters
    return (
        make_components("service", own, "down")
        | make_components("service", its, "down")
        | needs.master_query_components(context, own, its)
    )


def _find_other_types(context: CheckContext) -> list[str]:
    """Find the topics of the target's robot that have another type under their name here: nothing of them crosses."""
    own, its = context.robots
    here, there = context.state.exchanges.robots[own].sums, context.state.exchanges.robots[its].sums
    found = []
    for item in context.state.exchanges.robots[its].own:
        if item.kind != "publisher" or item.node == RELAY or item.node.startswith(TEST_NODES):
            continue
        for name in _find_names(context, item.kind, item.name):
            kind, other = there.get(item.name, ("", ""))[0], here.get(name, ("", ""))[0]
            if kind and other and kind != other:
                found.append(f"{item.name} of {its} is {kind}, and {name} of {own} is {other}")
    # A roscore has the type of the last publisher, so nodes that subscribe another one have said it themselves.
    for one in _list_crossing(context):
        if one.unlike:
            nodes = shorten_list(one.unlike, NAMED)
            name_there = _find_name_there(context, one.topic)
            found.append(
                f"{name_there} of {its} has another type than {one.topic} of {own}, as {nodes} there subscribes it"
            )
    return sorted(set(found))


def _find_name_there(context: CheckContext, topic: str) -> str:
    """Find the target's name of a topic that crosses, by the observer's name of it; the latter if its roscore has none."""
    own = context.state.exchanges.robots[context.robots[1]].own
    names = (item.name for item in own if item.kind == "publisher" and item.node != RELAY)
    return next((name for name in names if topic in _find_names(context, "publisher", name)), topic)


def _list_crossing(context: CheckContext) -> Sequence[CrossingTopic]:
    """List the topics of the target's robot that were heard through both relays."""
    return next((one.crossing for one in context.probe.relays if one.robot == context.robots[1]), ())


def _find_unreached(context: CheckContext) -> tuple[str, Components]:
    """Find why the relay of the target's robot is not reached, or the port of its data: in words, and the components that are sure."""
    own, its = context.masters
    row = next((one for one in context.probe.relays if one.robot == context.robots[1]), None)
    if row is None or row.outcome == Outcome.NOT_TRIED:
        return "", frozenset()
    is_data = row.outcome == Outcome.ANSWERED
    outcome, port = (row.data_outcome, row.data_port) if is_data else (row.outcome, row.port)
    if outcome == Outcome.OPEN:
        return "", frozenset()
    found = f"{'the port of its data' if is_data else 'its port'} {port}: {row.error or outcome.value}"
    broken = find_broken_relay(context, its)
    if broken:
        return found, broken
    if outcome == Outcome.REFUSED and not is_data:
        return found, make_components("service", its, "down", what=UNIT)
    drop = context.state.filters.find_drop(own, its, "nodes", port)
    if drop is not None:
        return found, frozenset({drop})
    return found, make_components(
        "node", its, "fenced", what=RELAY
    ) if outcome == Outcome.NO_ANSWER and is_data else frozenset()


@Check(
    title="relay of the other robot is reached, and the port of its data",
    scope=MASTER,
    suspects=_suspects,
)
def _judge_relay_reached(context: CheckContext) -> Judgement | None:
    if not any(one.robot == context.robots[1] for one in context.probe.relays):
        return None
    found, broken = _find_unreached(context)
    return judge_fault(FAILED, "an answer, and an open port", found, "both", broken)


def _list_unheard(context: CheckContext) -> list[CrossingTopic]:
    """List topics of the target's robot of which no header came through both relays. If its nodes are silent there, too, that is said there."""
    silent = context.peer.probe.exchange.silent if context.peer else ()
    failed = (one for one in _list_crossing(context) if one.outcome not in (Outcome.ANSWERED, Outcome.NOT_TRIED))
    return [one for one in failed if not set(one.nodes) <= set(silent)]


def _data_suspects(context: CheckContext) -> Components:
    own, its = context.masters
    relays = make_components("relay", its, "mute") | make_components("relay", own, "mute")
    return relays | needs.master_query_components(context, own, its)


@Check(
    title="data crosses by the relay",
    scope=MASTER,
    when=lambda context: any(one.robot == context.robots[1] and one.crossing for one in context.probe.relays),
    suspects=_data_suspects,
)
def _judge_relay_data(context: CheckContext) -> Judgement:
    own, its = context.masters
    unheard = _list_unheard(context)
    found = "; ".join(f"{one.topic}: {one.error or one.outcome.value}" for one in unheard)
    broken = find_broken_relay(context, own, its) if unheard else frozenset()
    if not broken:  # the other relay gives it: so that of this robot does not
        broken = join_components(
            make_components("relay", own, "mute", what=one.topic) for one in unheard if one.there == Outcome.ANSWERED
        )
    return judge_fault(FAILED, "the header of a publisher, through both relays", found, "it came", broken)


@Check(
    title="topics that cross by the relay have one type",
    scope=MASTER,
)
def _judge_relay_types(context: CheckContext) -> Judgement | None:
    robots = context.state.exchanges.robots
    if not _list_channels(context) or any(robot not in robots for robot in context.robots):
        return None
    found = shorten_list(_find_other_types(context), NAMED)
    component = Component.from_pair("messages", "differ", *context.robots, what=found)
    return judge_fault(FAILED, "one type of each topic on both sides", found, "so", frozenset({component}))


@Check(
    title="topics of the relay are there",
    scope=MASTER,
    suspects=_suspects,
)
def _judge_relay(context: CheckContext) -> Judgement | None:
    wrong = _find_wrong(context) if _list_channels(context) else None
    if wrong is None:
        return None
    missing, more = wrong
    parts = [("not there", missing), ("there without an owner", more)]
    found = "; ".join(f"{words}: {shorten_list(topics, NAMED)}" for words, topics in parts if topics)
    lacking = Component.from_pair("relay", "lacking", *context.robots, what=shorten_list(missing or more, NAMED))
    broken = find_broken_relay(context, *context.masters) or _find_unreached(context)[1] or frozenset({lacking})
    return judge_fault(FAILED, "the topics of the channels", found, "just that", broken)
