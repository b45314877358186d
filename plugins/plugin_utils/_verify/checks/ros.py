# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Checks of ROS between two computers: a subscriber of the one hears a talker of the other."""

from __future__ import annotations

from ..._base.hosts import host_of
from ..context import needs, stages
from ..context.check_context import CheckContext
from ..context.needs import Components, make_components
from ..context.stages import Stage
from ..observe.observations import HeardTopic, Probe
from ..observe.outcomes import Outcome
from .engine import FAILED, MEMBER, OK, UNKNOWN, WARNING, Check, Judgement

# A topic is heard


def _gives_nothing(context: CheckContext) -> bool:
    """The target's robot declares that it gives the observer's nothing."""
    own, its = context.robots
    return own != its and context.state.exchanges.flows.declares_nothing(its, own)


def _topic_needs(context: CheckContext) -> Components:
    """A topic that is heard need not be registered here: the other robot may have registered this subscriber, and called it.

    A discovery node may have reported it on a connection that was there before a packet filter: that port is not cleared.
    """
    connected = needs.node_connection_components(context, context.observer.name, context.target)
    if context.topic is not None and not any(publisher.uri for publisher in context.topic.publishers):
        return connected
    registered = needs.registration_components(context, context.observer.name, context.target)
    return connected | (registered - needs.passes(*context.masters, "rpc"))


def _topic_suspects(context: CheckContext) -> Components:
    """A topic that is registered at the observer's roscore needs only the connection."""
    one, other, topic = context.observer.name, context.target, context.topic
    listens = make_components("registration", one, "listener")
    if topic is None:
        there = make_components("computer", other, "off", "unmeasured", "login") | needs.roscore(
            context, other, context.masters[1]
        )
        return there | make_components("registration", other, "talker") | listens
    if not topic.listened:
        return (
            listens | make_components("computer", one, "overloaded") | needs.roscore(context, one, context.masters[0])
        )
    stage = stages.find_stage(stages.observe_call(context))
    if stage == Stage.REGISTERED:
        return needs.home_components(context, other)
    reported = needs.passes(context.masters[0], one, "nodes")  # its roscore reports a new publisher to it
    odd = make_components("computer", one, "overloaded") | needs.large(context, one, other)
    if topic.reached_outcome == Outcome.OPEN:  # its message is late, or too large
        return odd | make_components("computer", other, "overloaded") | reported | listens
    if topic.publishers:
        return needs.node_connection_components(context, one, other) - listens | reported | odd
    own, its = context.masters
    beyond = make_components("sync", own, "configuration") | needs.discovery(own) | needs.heartbeats(context, own, its)
    sizes = needs.large(context, own, its) | needs.large(context, one, own) | needs.large(context, other, its)
    return needs.registration_components(context, one, other) | sizes | (beyond if own != its else frozenset())


def _find_topic_fault(context: CheckContext, topic: HeardTopic) -> Components:
    if not topic.listened:
        return frozenset()
    if stages.is_filtered(context, topic.topic):
        return make_components("declaration", context.robots[0], "narrow", what="the test topic /multimaster_verify/*")
    there = context.peer.probe if context.peer else Probe()
    # Without its roscore no talker runs.
    if there.talker and not there.talker.running and not there.roscore.error and not topic.publishers:
        return make_components("registration", context.target, "talker", what=there.talker.error)
    return stages.find_lacking(context, stages.find_stage(stages.observe_call(context)), topic.topic)


@Check(
    title="subscriber hears the other's talker",
    scope=MEMBER,
    needs=_topic_needs,
    suspects=_topic_suspects,
    carries="nodes",
)
def _judge_topic_heard(context: CheckContext) -> Judgement | None:
    target = context.peer
    if not context.observer.is_probed or target is None or context.observer.lacks_ros or _gives_nothing(context):
        return None
    entry = context.topic
    if entry is None:
        # A talker that never was is no fault of this pair.
        silent = target.seen.unreachable or (target.seen.probe is not None and target.lacks_ros)
        return None if silent else Judgement(FAILED, "its message", "not listened to")
    expected = f"a message on {entry.topic}"
    if entry.heard:
        return Judgement(OK, expected, "heard")
    broken = _find_topic_fault(context, entry)
    if stages.is_filtered(context, entry.topic):
        found = "the topic is left out by multimaster_filters"
        return Judgement(UNKNOWN, expected, found, broken, entry.reached_outcome)
    return Judgement(FAILED, expected, entry.error or "nothing", broken, entry.reached_outcome)


# The connection is direct


@Check(
    title="rostopic info shows a direct connection",
    scope=MEMBER,
    suspects=lambda context: needs.registration_components(context, context.observer.name, context.target),
)
def _judge_direct_connection(context: CheckContext) -> Judgement | None:
    if context.topic is None or not context.topic.publishers:
        return None
    publishers = context.topic.publishers
    called = context.ways.called[context.target]
    good = all(host_of(publisher.uri) in called for publisher in publishers)
    found = ", ".join(publisher.uri or f"{publisher.node}, which is not registered here" for publisher in publishers)
    others = sorted({host_of(publisher.uri) or publisher.uri for publisher in publishers if publisher.uri} - called)
    expected = f"the publisher is on {context.target}"
    if good:
        return Judgement(OK, expected, found)
    if others:
        broken = make_components(
            "environment", context.target, "shell", what=f"they call themselves {', '.join(others)}"
        )
    else:  # it is heard all the same if the other robot has registered the subscriber
        stage = stages.find_stage(stages.observe_exchange(context, context.topic.topic))
        broken = stages.find_lacking(context, stage, context.topic.topic)
    return Judgement(FAILED, expected, found, broken)


# Throughput, if it is measured


@Check(
    title="throughput",
    scope=MEMBER,
    needs=lambda context: (
        needs.slow(context, context.observer.name, context.target) if context.state.least else frozenset()
    ),
    shown=True,
)
def _judge_throughput(context: CheckContext) -> Judgement | None:
    """Judge by the expectation of the user: only the user knows how fast a link is to be."""
    stream = context.observer.streams.get(context.target)
    if stream is None or context.peer is None:
        return None
    expected = f"at least {context.state.least:g} Mbit/s" if context.state.least else "any"
    if stream.mbit_s is None:
        return Judgement(UNKNOWN, expected, f"not measured: {stream.error}")
    return Judgement(OK if stream.mbit_s >= context.state.least else WARNING, expected, f"{stream.mbit_s:.1f} Mbit/s")
