# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Checks of the exchange between robots: the content of their roscores, compared with the planned flows."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Iterable, Sequence
from itertools import islice

from ..._base.sentences import shorten_list
from ..components.component import Component
from ..context import needs, stages
from ..context.announcements import Misplaced
from ..context.check_context import CheckContext
from ..context.needs import Components, join_components, make_components
from ..context.registrations import RELAY, TEST_NODES, Clash, Conflict, RegisteredItem
from ..context.stages import Stage
from ..observe.observations import Exchange, SilentNode, UnreachedNode
from ..observe.outcomes import Outcome
from .engine import FAILED, OK, ROSCORES, UNKNOWN, WARNING, Check, Judgement, judge_fault
from .programs import find_full
from .relay import find_broken_relay

NAMED = 4  # registrations, names or connections that a finding names
# Components of one row: two hostile robots may have a hundred thousand names in common.
MOST_COMPONENTS = 100


# Hosts of nodes


def _has_content(context: CheckContext) -> bool:
    return context.exchange is not None and not context.exchange.error


@Check(
    title="nodes announce a host at which others reach them",
    when=_has_content,
)
def _judge_node_hosts(context: CheckContext) -> Judgement:
    robot = context.observer.plan.robot
    misplaced = context.state.misplaced.get(robot, {})
    others = context.state.exchanges.robots.keys() - {robot}
    # It may be intended: a tool of the operator that uses the roscore of a robot is no failure.
    harmful = {node for node, one in misplaced.items() if one.mode != "robot"}
    is_given = bool(harmful) and any(
        item.node in harmful for other in others for item in context.state.exchanges.find_due(robot, other)
    )
    verdict = FAILED if is_given else WARNING
    found = shorten_list(map(str, misplaced.values()), NAMED)
    components = frozenset(one.component for one in misplaced.values())
    return judge_fault(verdict, "planned names and addresses of the robot", found, "only such", components)


@Check(
    title="nodes use the roscore of their robot",
    when=lambda context: context.observer.is_probed and not context.observer.plan.is_router,
)
def _judge_node_roscores(context: CheckContext) -> Judgement:
    strays = context.state.strays.get(context.observer.name, [])
    components = frozenset(one.component for one in strays)
    found = shorten_list(map(_describe_stray, strays), NAMED)
    scan = context.observer.probe.unregistered
    sample = (
        f"; {scan.asked} of {scan.unknown} processes were asked, which is a sample" if scan.asked < scan.unknown else ""
    )
    told = f"{found}{sample}" if found else ""
    return judge_fault(WARNING, "registered at the roscore of the robot", told, f"only such{sample}", components)


def _describe_stray(one: Misplaced) -> str:
    return f"{one} is registered at no roscore" if one.mode == "unregistered" else str(one)


# Registered nodes

BUSY = 3.0  # on a computer that is so many times as slow as if it were idle, a silent node may wait for a processor
OWN_NODES = {
    "/master_discovery": "discovery",
    "/master_sync": "sync",
    "/mas_discovery": "discovery",
    "/mas_sync": "sync",
}


def _silent_suspects(context: CheckContext) -> Components:
    """Suspect that the nodes have ended, or that their computers are not reached.

    A computer of the fleet refuses a port on which no program listens. So silence there does not show that a node has ended.
    """
    one = context.observer.name
    silences = context.exchange.silences if context.exchange else ()
    of_robot = {member.name for member in context.fleet.members if member.robot == context.observer.plan.robot}
    computers = {context.ways.name_at(entry.host) or entry.host for entry in silences} & of_robot or of_robot
    may_have_ended = not silences or any(
        entry.outcome != Outcome.NO_ANSWER
        or (context.ways.name_at(entry.host) or entry.host) not in context.fleet.computers
        for entry in silences
    )
    ended = make_components("registration", one, "ghost") if may_have_ended else frozenset()
    return ended | join_components(
        needs.node_connection_components(context, one, other) for other in computers if other != one
    )


def _find_silent_components(context: CheckContext, exchange: Exchange) -> Components:
    """Find the components that the silence of nodes shows: hung nodes of the collection or of fkie_mas, the relay, talkers, nodes of people.

    Services that do not run have a check of their own.
    """
    nodes = join_components(
        _blame_silence(context, kind, context.observer.name)
        for node, kind in OWN_NODES.items()
        if node in exchange.silent
    )
    misplaced = context.state.misplaced.get(context.observer.plan.robot, {})
    relay = find_broken_relay(context, context.observer.name) if RELAY in exchange.silent else frozenset()
    left_out = {*misplaced, *([RELAY] if relay else [])}
    others = [entry for entry in exchange.silences if entry.node not in left_out]
    refused = [entry.node for entry in others if _has_ended(context, entry)]
    ended = make_components("registration", context.observer.name, "ghost", what=shorten_list(refused, NAMED))
    people = join_components(_find_people_components(context, entry) for entry in others if not _is_ours(entry.node))
    return nodes | relay | stages.find_mute_talkers(context) | people | (ended if refused else frozenset())


def _blame_silence(context: CheckContext, kind: str, computer: str, what: str = "") -> Components:
    """Name the reason for a node that takes connections and does not answer: a process with too many files, a busy computer, or a hung node.

    `kind` and `what` are those of the component of a hung node. A computer is no reason if a process is stopped there.
    """
    there = context.run.get(computer)
    if there is not None and what and (full := find_full(there.probe, what, computer)):
        return full
    if there is not None and there.probe.pace >= BUSY and not any(one.stopped for one in there.probe.node_hosts):
        return make_components("computer", computer, "overloaded")
    return make_components(kind, computer, "hung", what=what)


def _is_ours(node: str) -> bool:
    return node in OWN_NODES or node.startswith(TEST_NODES)


def _find_people_components(context: CheckContext, entry: SilentNode) -> Components:
    """Find why a person's node does not answer: it takes connections and hangs, or a packet filter drops them."""
    computer = context.ways.name_at(entry.host) or entry.host
    if computer not in context.fleet.computers:
        return frozenset()
    if entry.tcp_outcome == Outcome.OPEN:
        return _blame_silence(context, "node", computer, entry.node)
    if entry.outcome == Outcome.ANSWERED or computer == context.observer.name:
        return frozenset()
    drop = context.state.filters.find_drop(context.observer.name, computer, "nodes", entry.port)
    if drop is not None:
        return frozenset({drop})
    # The talker there is heard, so the way and the other ports are fine.
    is_fenced = entry.tcp_outcome == Outcome.NO_ANSWER and _is_heard(context, computer)
    return make_components("node", computer, "fenced", what=entry.node) if is_fenced else frozenset()


def _is_heard(context: CheckContext, computer: str) -> bool:
    topic = context.observer.topics.get(computer)
    return topic is not None and topic.heard


def _has_ended(context: CheckContext, entry: SilentNode) -> bool:
    """Return True if a node has ended: its computer refuses the connection, and no packet filter does."""
    computer = context.ways.name_at(entry.host) or entry.host
    filtered = context.state.filters.find_drop(context.observer.name, computer, "nodes", entry.port)
    return entry.outcome == Outcome.REFUSED and filtered is None


@Check(
    title="registered nodes answer",
    needs=lambda context: (
        make_components("sync", context.observer.name, "hung")
        | make_components("discovery", context.observer.name, "hung")
    ),
    suspects=_silent_suspects,
)
def _judge_nodes_answer(context: CheckContext) -> Judgement | None:
    if context.exchange is None or context.exchange.error:
        return None
    misplaced = context.state.misplaced.get(context.observer.plan.robot, {})
    expected = "every node that is registered answers"
    silent = [node for node in context.exchange.silent if node not in misplaced]
    if not silent:
        return Judgement(OK, expected, "they answer")
    broken = _find_silent_components(context, context.exchange)
    return Judgement(WARNING, expected, f"no answer of {shorten_list(silent, NAMED)}", broken)


# Nodes of other robots, as their subscribers here reach them


def _list_unreached(context: CheckContext) -> list[tuple[str, UnreachedNode]]:
    """List the nodes of the target's robot to which no connection opens, with their computers. One that has ended is reported at its own roscore."""
    robot, state = context.robots[1], context.state
    seen = context.peer.probe.exchange.silent if context.peer else ()
    left_out = {*state.misplaced.get(robot, {}), *seen, *OWN_NODES, RELAY}
    entries = context.exchange.unreached if context.exchange else ()
    placed = ((context.ways.name_at(entry.host) or entry.host, entry) for entry in entries)
    return [
        (computer, entry)
        for computer, entry in placed
        if entry.outcome not in (Outcome.REFUSED, Outcome.NOT_TRIED)
        and entry.node not in left_out
        and computer in context.fleet.computers
        and context.fleet.computers[computer].robot == robot
    ]


def _is_shut(context: CheckContext, computer: str) -> bool:
    """Return True if the talker of the verification is not heard from there either, so that something else may be the reason."""
    topic = context.observer.topics.get(computer)
    return topic is not None and not topic.heard


def _find_fences(context: CheckContext, unreached: Iterable[tuple[str, UnreachedNode]]) -> Components:
    """Find the rules that drop connections to these nodes, and the nodes to which no connection opens, if no talker says the same."""
    components: Components = frozenset()
    for computer, entry in unreached:
        drop = context.state.filters.find_drop(context.observer.name, computer, "nodes", entry.port)
        if drop is not None:
            components |= {drop}
        elif not _is_shut(context, computer):
            components |= make_components("node", computer, "fenced", what=entry.node)
    return components


@Check(
    title="nodes of the other robot take connections",
    scope=ROSCORES,
    when=_has_content,
    suspects=lambda context: join_components(
        needs.talks(context, context.observer.name, computer, "nodes") for computer, _entry in _list_unreached(context)
    ),
)
def _judge_nodes_reached(context: CheckContext) -> Judgement:
    unreached = _list_unreached(context)
    found = shorten_list((f"{entry.node} on {computer}: {entry.error}" for computer, entry in unreached), NAMED)
    return judge_fault(FAILED, "each port of a node opens", found, "they open", _find_fences(context, unreached))


# Names


def _has_both_contents(context: CheckContext) -> bool:
    return context.exchange is not None and all(robot in context.state.exchanges.robots for robot in context.robots)


@Check(
    title="no node or service name twice",
    scope=ROSCORES,
    when=_has_both_contents,
)
def _judge_names(context: CheckContext) -> Judgement:
    own, its = context.robots
    clashes = context.state.exchanges.clashes(its, own)
    names = (f"the {clash.kind} {clash.name} is of {' and of '.join(clash.robots)}" for clash in clashes)
    twins = frozenset(
        Component.from_pair("registration", "twin", *clash.robots, what=f"{clash.kind} {clash.name}")
        for clash in clashes[:MOST_COMPONENTS]
    )
    return judge_fault(FAILED, "each name once", shorten_list(names, NAMED), "no name twice", twins)


# Types


def _describe_conflict(conflict: Conflict) -> str:
    (one, its_type, its_sum), (other, type_name, md5sum) = sorted((conflict.one, conflict.other))
    if its_type != type_name:
        return f"{conflict.topic} is {its_type} on {one} and {type_name} on {other}"
    return f"{conflict.topic} is {type_name} on both, with the md5 sum {its_sum} on {one} and {md5sum} on {other}"


def _make_conflict_component(context: CheckContext, conflict: Conflict) -> Component:
    odd = context.state.exchanges.odd(conflict)
    if odd:
        return Component("messages", odd, "differ", conflict.topic)
    return Component.from_pair("messages", "differ", *context.robots, what=conflict.topic)


@Check(
    title="topics have the same type on both sides",
    scope=ROSCORES,
)
def _judge_types(context: CheckContext) -> Judgement | None:
    if context.exchange is None or not _has_both_contents(context):
        return None
    own, its = context.robots
    conflicts, expected = context.state.exchanges.conflicts(its, own), "each topic has one type"
    if conflicts:
        broken = frozenset(_make_conflict_component(context, conflict) for conflict in conflicts[:MOST_COMPONENTS])
        return Judgement(FAILED, expected, shorten_list(map(_describe_conflict, conflicts), NAMED), broken)
    error = context.exchange.types_error
    found = f"the md5 sums are not known: {error}" if error else ""
    unread = make_components("messages", context.observer.name, "unknown", what=error)
    if context.exchange.types_outcome == Outcome.NO_ANSWER:  # late is not never
        unread = make_components("computer", context.observer.name, "overloaded")
    return judge_fault(UNKNOWN, expected, found, "the same types", unread)


# Topics of two publishers


def _list_sharers(shared: Iterable[Clash]) -> Components:
    """List one component for each two robots that publish the same topics, whichever robot hears both of them."""
    topics: dict[tuple[str, str], list[str]] = defaultdict(list)
    for clash in shared:
        topics[clash.robots].append(clash.name)
    return frozenset(
        Component.from_pair("topic", "shared", *robots, what=shorten_list(names, NAMED))
        for robots, names in topics.items()
    )


@Check(
    title="no topic of two robots",
    scope=ROSCORES,
    when=_has_both_contents,
)
def _judge_shared_topics(context: CheckContext) -> Judgement:
    own, its = context.robots
    shared = context.state.exchanges.find_shared_topics(its, own)
    found = shorten_list((f"{clash.name} of {' and of '.join(clash.robots)}" for clash in shared), NAMED)
    expected = "each topic is published by one robot"
    return judge_fault(WARNING, expected, found, "no topic of two robots", _list_sharers(shared))


# Bridges to ROS 2


@Check(
    title="no circle by two bridges to ROS 2",
    scope=ROSCORES,
    when=_has_both_contents,
)
def _judge_bridges(context: CheckContext) -> Judgement:
    own, its = context.robots
    found = shorten_list(context.state.exchanges.find_bridged_topics(its, own), NAMED)
    circle = frozenset({Component.from_pair("topic", "circle", own, its, what=found)})
    return judge_fault(WARNING, "each topic passes one bridge", found, "no topic passes two", circle)


# The flow

BETWEEN = (Stage.DISCOVERED, Stage.GIVEN, Stage.PLANNED, Stage.IMPORTED)  # two roscores
ASKED = 20  # topics whose stages are looked at
MOST_REGISTRATIONS = 5000  # of one master: the same number as in the nodes' sync/core/limits.py


def _flow_suspects(context: CheckContext) -> Components:
    own, its = context.masters
    sync = make_components("sync", own, "dead", "hung", "configuration")
    fetched = needs.discovery(own) | needs.master_query_components(context, own, its) | needs.large(context, own, its)
    return sync | fetched | needs.heartbeats(context, own, its)


def _find_flow_faults(
    context: CheckContext, missing: Sequence[RegisteredItem], superfluous: Sequence[RegisteredItem]
) -> Components:
    """Find the components to which a wrong flow points; superfluous registrations come from parameters of the sync node."""
    own, its = context.robots
    observer = context.observer.name
    if superfluous:
        return make_components("sync", observer, "configuration", what=shorten_list(map(str, superfluous), NAMED))
    if len(context.state.exchanges.find_imports(its, own)) >= MOST_REGISTRATIONS:
        return make_components("sync", observer, "limit", what=context.target)
    refused = stages.find_refusals(context, [name for item in missing for name in (item.name, item.node)])
    if _loses_large(context):
        return refused  # the answers over HTTP come in large packets: no node is at fault
    lacking = _find_lacking_stages(context, (item.name for item in missing if item.kind == "publisher"))
    return refused or join_components(stages.find_lacking(context, stage, topic) for topic, stage in lacking.items())


def _loses_large(context: CheckContext) -> bool:
    """Return True if small packets arrive between the two, and large ones do not."""
    small, large = context.member.ping_address, context.member.ping_large
    return small is not None and large is not None and small.ok and not large.ok


def _find_lacking_stages(context: CheckContext, missing: Iterable[str] = ()) -> dict[str, Stage]:
    """Find the stages that lack topics of the target's robot: those of its talkers that are not here, and others that are missing.

    A talker may be heard all the same, if the other robot has registered the subscriber.
    """
    asked = (
        topic for source in context.probe.sources if source.computer == context.masters[1] for topic in source.topics
    )
    talkers = (topic for topic in asked if not stages.is_filtered(context, topic))
    topics = islice(dict.fromkeys([*talkers, *missing]), ASKED)
    found = {topic: stages.find_stage(stages.observe_exchange(context, topic)) for topic in topics}
    return {topic: stage for topic, stage in found.items() if stage in BETWEEN}


@Check(
    title="robot has the topics that it is to get, and no others",
    scope=ROSCORES,
    # registrations stay after a node has died, so a success clears no node
    needs=lambda context: make_components("sync", context.masters[0], "configuration"),
    suspects=_flow_suspects,
)
def _judge_flow(context: CheckContext) -> Judgement | None:
    if context.exchange is None:
        return None
    own, its = context.robots
    if context.exchange.error:
        untold = make_components("sync", context.observer.name, "untold")
        return Judgement(UNKNOWN, f"the topics of {its}", context.exchange.error, untold)
    missing, superfluous = context.state.exchanges.find_missing(its, own), context.state.exchanges.superfluous(its, own)
    parts: list[tuple[str, Sequence[object]]] = [("not there", missing), ("there against the plan", superfluous)]
    parts.append(
        ("of its talkers", [f"{name} is not {stage.value}" for name, stage in _find_lacking_stages(context).items()])
    )
    found = "; ".join(f"{words}: {shorten_list(map(str, items), NAMED)}" for words, items in parts if items)
    broken = _find_flow_faults(context, missing, superfluous) if found else frozenset()
    return judge_fault(FAILED, f"the topics of {its} for {own}, and no others", found, "just that", broken)


# Parameters that cross


def _list_copied(context: CheckContext) -> list[tuple[str, str]]:
    """List the parameters that the observer's robot is to have as the target's robot has them: the names here and there."""
    entries = context.observer.plan.sync.get("sync_parameters", ())
    return [
        (entry.get("as", "") + name, name)
        for entry in entries
        if entry["from"] == context.master.name
        for name in entry["names"]
    ]


def _compare_copies(context: CheckContext) -> dict[str, str] | None:
    """Return the fault of each copy, by its parameter; None if one of the two roscores was not read."""
    master = context.run.get(context.masters[1])
    if master is None or not master.is_probed or not context.observer.is_probed:
        return None
    here, there = (
        {entry.name: entry.digest for entry in probe.parameters.crossing} for probe in (context.probe, master.probe)
    )
    names = _list_copied(context)
    if not all(name in here and its_name in there for name, its_name in names):
        return None
    own, its = context.robots
    return {
        name: f"{its_name} of {its} " + (f"has another value on {own}" if here[name] else f"is not on {own}")
        for name, its_name in names
        if there[its_name] and here[name] != there[its_name]
    }


def _find_copy_faults(context: CheckContext, wrong: Collection[str]) -> Components:
    """Find the fault of copies: none if copies and registrations are missing alike, since then the sync node is at fault."""
    own, its = context.robots
    is_read = context.exchange is not None and not context.exchange.error
    if (
        is_read
        and not any("another value" in words for words in wrong)
        and context.state.exchanges.find_missing(its, own)
    ):
        return frozenset()
    return frozenset({Component.from_pair("parameter", "copy", own, its, what=shorten_list(wrong, NAMED))})


@Check(
    title="copied parameters are as on their robot",
    scope=ROSCORES,
    when=lambda context: bool(_list_copied(context)),
    suspects=_flow_suspects,
)
def _judge_copies(context: CheckContext) -> Judgement:
    wrong = _compare_copies(context)
    if wrong is None:
        found = "the parameters of one of the two are not known"
        return Judgement(UNKNOWN, "the same values", found, _find_copy_faults(context, ()))
    broken = _find_copy_faults(context, wrong.values()) if wrong else frozenset()
    return judge_fault(FAILED, "the same values", shorten_list(wrong.values(), NAMED), "the same", broken)


# Connections


@Check(
    title="connections only as exchanged",
    scope=ROSCORES,
)
def _judge_cross_link(context: CheckContext) -> Judgement | None:
    if context.exchange is None or context.exchange.error:
        return None
    crossing = context.state.exchanges.find_crossing_links(context.exchange.connections, *context.robots)
    links = (
        f"{link.node} {'hears' if link.direction == 'in' else 'is heard by'} {link.peer} of {link.robot} on {link.topic}"
        for link in crossing
    )
    between = frozenset({Component.from_pair("registration", "link", *context.robots)})
    expected = "only connections of exchanged topics"
    return judge_fault(FAILED, expected, shorten_list(links, NAMED), "only such", between)
