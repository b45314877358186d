# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The stages of a call: from the registration of a publisher at its own roscore to a message that its subscriber reads.

Each stage is asked of the component that has it. The first one that lacks the call is the finding. What could not be asked,
as some of upstream's nodes, is not known: then nothing is concluded here, and the components that the call needs are suspected.
"""

from __future__ import annotations

from collections.abc import Mapping
from enum import Enum

from ..._base.sentences import shorten_list
from ..observe.observations import Exchange, GivenTopics, HeardTopic, RefusedName
from ..observe.outcomes import Outcome
from .check_context import CheckContext, Participant
from .needs import Components, join_components, make_components
from .registrations import TEST_NODES, RegisteredItem
from .ways import Ways

FILTERS = ("ignore_", "sync_", "hide_", "do_not_sync")  # how the names of filters begin
TALKER_TYPE, TALKER_NODE = "std_msgs/String", f"{TEST_NODES}talker_"
TALKER = "the talker of the verification"
NAMED = 4  # names that a finding names


class Stage(Enum):
    """The stages, in the order of the call; the values are for people."""

    REGISTERED = "registered at its own roscore"
    DISCOVERED = "in the state of its discovery node"
    GIVEN = "given to the other robot, when asked as its sync node asks"
    PLANNED = "taken by the parameters of the sync node, and not refused"
    IMPORTED = "registered at the other roscore"
    ANNOUNCED = "announced to the subscriber by its roscore"
    CONNECTED = "connected"
    READ = "a message is read"


Seen = Mapping[Stage, bool | None]  # True if the stage has the call; None if it was not asked, or did not say


def find_stage(seen: Seen) -> Stage | None:
    """Return the first stage that lacks the call, if the one before it has it; None if that is not known.

    A call that a later stage has was at all stages before it: a registration may be gone since.
    """
    first = None
    for stage in reversed(Stage):
        has = seen.get(stage)
        if has:
            break
        first = stage if has is False else None
    return first


def is_filtered(context: CheckContext, topic: str) -> bool:
    """Return True if the filters between the two robots leave the topic of a talker out."""
    own, its = context.robots
    talker = RegisteredItem("publisher", topic, TALKER_NODE + topic.rpartition("/")[2])
    return own != its and not context.state.exchanges.flows.rules(its, own).passes(talker, TALKER_TYPE)


# The observations of each stage


def observe_call(context: CheckContext) -> dict[Stage, bool | None]:
    """Return for each stage if it has the topic of the target's talker."""
    topic = context.topic
    if topic is None:
        return {}
    return {
        **observe_exchange(context, topic.topic),
        Stage.IMPORTED: _is_here(context, topic),
        **_observe_listener(topic),
    }


def observe_exchange(context: CheckContext, topic: str) -> dict[Stage, bool | None]:
    """Return for the stages between two roscores if they have a topic of the target's robot."""
    own, its = (context.run.get(name) for name in context.masters)
    at_home = _find_source(its, context.masters[1])
    registered = topic in at_home.topics or _has_topic(_read_exchange(its), topic)
    if own is its:
        between: bool | None = registered or None  # there is nothing between
        return dict.fromkeys((Stage.DISCOVERED, Stage.GIVEN, Stage.PLANNED), between) | {Stage.REGISTERED: registered}
    gives = _is_given(context, own, its, topic)
    return {
        Stage.REGISTERED: registered,
        # of all topics of its roscore, the answer lists those that it does not have
        Stage.DISCOVERED: topic not in {*at_home.topics} - {*at_home.given}
        if registered and _has_answered(at_home)
        else None,
        Stage.GIVEN: gives,
        Stage.PLANNED: False if gives and own and _list_exclusions(own, [topic]) else gives,
        Stage.IMPORTED: _has_import(own, topic),
    }


def _read_exchange(master: Participant | None) -> Exchange | None:
    """Return the content of a roscore; None if it was not read."""
    if master is None or not master.is_probed or master.probe.exchange.error:
        return None
    return master.probe.exchange


def _has_topic(exchange: Exchange | None, topic: str) -> bool | None:
    if exchange is None:
        return None
    return any(entry.name == topic and entry.publishers for entry in exchange.topics)


def _has_import(own: Participant | None, topic: str) -> bool | None:
    exchange = _read_exchange(own)
    if exchange is None:
        return None
    entries = (entry for component in exchange.imports for entry in component.topics)
    return any(entry.name == topic and entry.publishers for entry in entries)


def _is_here(context: CheckContext, topic: HeardTopic) -> bool | None:
    """The observer's roscore has the topic, or had it. A topic that came only after the end of the listener says nothing."""
    own = context.run.get(context.masters[0])
    if topic.publishers:
        return True
    same = context.masters[0] == context.masters[1]
    has = _has_topic(_read_exchange(own), topic.topic) if same else _has_import(own, topic.topic)
    return None if has else has


def _find_source(asker: Participant | None, computer: str) -> GivenTopics:
    entries = asker.probe.sources if asker else ()
    return next((entry for entry in entries if entry.computer == computer), GivenTopics(computer))


def _has_answered(source: GivenTopics) -> bool:
    return source.outcome == Outcome.ANSWERED


def _is_given(context: CheckContext, own: Participant | None, its: Participant | None, topic: str) -> bool | None:
    """Return True if the other discovery node gives the topic to the own sync node; None if it was not asked.

    A node that serves as planned, and has given the topics of all talkers, which are new, gives the others, too.
    """
    source = _find_source(own, context.masters[1])
    if own is None or not _is_listed(context, own):
        return None
    if _has_answered(source) and topic in source.topics:
        return topic in source.given
    parameters = its.probe.parameters if its else None
    if parameters is None or "master_discovery" not in parameters.nodes or its is None:
        return None
    differs = any(entry.node == "master_discovery" for entry in parameters.differing)
    talkers = _find_source(its, context.masters[1]).given
    arrived = bool(talkers) and all(_has_import(own, other) for other in talkers)
    return True if arrived and not differs else None


def _is_listed(context: CheckContext, own: Participant) -> bool:
    """The own discovery node has the other master online: else its sync node does not hear of it."""
    master = context.fleet.master_of.get(context.robots[1])
    entry = own.listed.get(master.name) if master else None
    return entry is not None and entry.online


def _list_exclusions(own: Participant, names: list[str]) -> list[str]:
    """List the components of a sync node that keep names out: its refusals, or filters that are not as planned."""
    refused = {name for service in own.probe.services for name in service.refused}
    other = [
        f"{entry.name} is {entry.found}"
        for entry in own.probe.parameters.differing
        if entry.node == "master_sync" and entry.name.startswith(FILTERS)
    ]
    return [name for name in names if name in refused] or other


def _observe_listener(topic: HeardTopic) -> dict[Stage, bool | None]:
    if not topic.listened:
        return {}
    said = topic.heard or bool(topic.text)
    opened = topic.step == "connected" or (topic.step == "told" and topic.reached_outcome == Outcome.OPEN)
    return {Stage.ANNOUNCED: said or bool(topic.step), Stage.CONNECTED: said or opened, Stage.READ: said}


# The component that lacks it


def find_refusals(context: CheckContext, names: list[str]) -> Components:
    """Return the sync node of the observer if it refuses some of these names, with its reasons if it reports them."""
    own = context.run.get(context.masters[0])
    services = own.probe.services if own else ()
    refused = {name for service in services for name in service.refused}
    names = list(dict.fromkeys(name for name in names if name in refused))
    reasons = {row.name: describe_refusal(row) for service in services for row in service.refusals}
    listed = [f"{name}: {reasons[name]}" for name in names if name in reasons]
    if listed:
        return make_components("sync", context.masters[0], "objects", what=shorten_list(listed, NAMED))
    return (
        make_components("sync", context.masters[0], "refuses", what=shorten_list(names, NAMED))
        if names
        else frozenset()
    )


def describe_refusal(row: RefusedName) -> str:
    """Say why a sync node refuses a name."""
    words = {
        "node": f"a node at {row.here} has this name",
        "service": f"{row.here} provides it",
        "type": f"it is {row.there} there and {row.here} here",
        "place": f"it is at {row.there}, an address at which no node of {row.master} can be: {row.here}",
    }
    return words.get(row.kind, row.here)


def find_lacking(context: CheckContext, stage: Stage | None, topic: str) -> Components:
    """Return the component that lacks the call first, with its computer; nothing if the way to it has to be looked at."""
    own, its = context.masters
    if stage == Stage.DISCOVERED:
        return make_components("discovery", its, "stale", what=topic)
    if stage == Stage.GIVEN:
        return make_components("discovery", its, "configuration")
    if stage == Stage.PLANNED:
        computer = context.run.get(own)
        others = shorten_list(_list_exclusions(computer, [topic]) if computer else [], NAMED)
        return find_refusals(context, [topic]) or make_components("sync", own, "configuration", what=others)
    if stage == Stage.IMPORTED and own != its:
        return make_components("sync", own, "stale", what=context.robots[1])
    return _find_lacking_node(context, stage)


def _find_lacking_node(context: CheckContext, stage: Stage | None) -> Components:
    """Return the node that lacks the call, or the packet filter that keeps it from it."""
    one, other, topic = context.observer.name, context.target, context.topic
    if stage == Stage.REGISTERED:
        return make_components("registration", other, "talker") if _has_talker(context.peer) else frozenset()
    if stage == Stage.ANNOUNCED and one != context.masters[0]:
        return _find_drop(context, context.masters[0], one) or make_components("registration", one, "untold")
    if stage == Stage.CONNECTED and topic is not None and topic.step == "answered":
        return _find_drop(context, one, other) or make_components("registration", other, "closed")
    master = context.run.get(context.masters[1])
    if stage == Stage.READ and topic is not None and topic.step == "told" and _is_silent(master, other, context.ways):
        return make_components("registration", other, "mute", what=TALKER)
    return frozenset()


def _has_talker(computer: Participant | None) -> bool:
    """Return True if a talker was started there, and its roscore answers."""
    probe = computer.seen.probe if computer else None
    return probe is not None and not probe.roscore.error and probe.talker is not None


def _find_drop(context: CheckContext, sender: str, target: str) -> Components:
    drop = context.state.filters.find_drop(sender, target, "nodes")
    return frozenset({drop}) if drop else frozenset()


def find_mute_talkers(context: CheckContext) -> Components:
    """Return the talkers of the observer's robot that take its connections, and say nothing on two of them."""
    untouched = (
        entry for entry in context.observer.topics.values() if _observe_listener(entry).get(Stage.READ) is False
    )
    mute = (entry for entry in untouched if entry.step == "told" and entry.reached_outcome == Outcome.OPEN)
    silent = (entry.computer for entry in mute if _is_silent(context.observer, entry.computer, context.ways))
    return join_components(make_components("registration", name, "mute", what=TALKER) for name in silent)


def _is_silent(master: Participant | None, computer: str, ways: Ways) -> bool:
    """The talker of a computer does not answer its own robot's master."""
    exchange = _read_exchange(master)
    return exchange is not None and any(
        entry.node.startswith(TALKER_NODE)
        and entry.outcome == Outcome.NO_ANSWER
        and (ways.name_at(entry.host) or entry.host) == computer
        for entry in exchange.silences
    )
