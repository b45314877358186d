# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Checks of the exchange between robots: what their roscores hold, compared with what they are to give each other."""

from __future__ import annotations

from collections.abc import Iterable

from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.case import Case
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.engine import (
    COMPUTER,
    FAILED,
    MASTER,
    OK,
    UNKNOWN,
    WARNING,
    Cause,
    Check,
    Documented,
    Judgement,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.exchange import Conflict

NAMED = 4  # registrations, names or connections that a finding names


def _some(items: Iterable[str]) -> str:
    """Join the first items, and say how many more there are."""
    texts = list(items)
    more = f" and {len(texts) - NAMED} more" if len(texts) > NAMED else ""
    return ", ".join(texts[:NAMED]) + more


# Registered nodes


def _nodes_answer(case: Case) -> Judgement | None:
    if case.exchange is None or case.exchange.error:
        return None
    silent = case.exchange.silent
    found = f"no answer of {_some(silent)}" if silent else "they answer"
    return Judgement(WARNING if silent else OK, "every node that is registered answers", found)


NODES_ANSWER = Check(
    id="nodes_answer",
    title="registered nodes answer",
    scope=COMPUTER,
    judge=_nodes_answer,
    documented=Documented("roscore", "each of the robot's nodes that is registered answers (warning)"),
    explained_by=("master_uri",),
    causes=(
        Cause(
            "they ended without saying so, as by kill -9 or a loss of power, and the roscore still hands out their addresses",
            "run on {observer}: rosnode cleanup; a node that hangs must be ended first",
        ),
    ),
)


# Names


def _both_seen(case: Case) -> bool:
    return case.exchange is not None and all(robot in case.exchanges.robots for robot in case.robots)


def _names(case: Case) -> Judgement | None:
    if not _both_seen(case):
        return None
    own, its = case.robots
    clashes = case.exchanges.clashes(its, own)
    found = _some(f"the {clash.kind} {clash.name} is of {' and of '.join(clash.robots)}" for clash in clashes)
    return Judgement(FAILED if clashes else OK, "each name once", found or "no name twice")


NAMES = Check(
    id="names",
    title="no node or service name twice",
    scope=MASTER,
    judge=_names,
    documented=Documented(
        "pair of roscores", "no node and no service that is exchanged has a name that another robot has too"
    ),
    causes=(
        Cause(
            "one name, two nodes: a roscore holds one of them, so the collection's nodes refuse the second, and upstream's end the "
            "first",
            "give one of them another name or a namespace of its robot, or leave it out by multimaster_exports or "
            "multimaster_filters",
        ),
    ),
)


# Types


def _types_unknown(case: Case) -> bool:
    own, its = case.robots
    return not case.exchanges.conflicts(its, own)


def _types(case: Case) -> Judgement | None:
    if case.exchange is None or not _both_seen(case):
        return None
    own, its = case.robots
    conflicts, expected = case.exchanges.conflicts(its, own), "each topic has one type"
    if conflicts:
        return Judgement(FAILED, expected, _some(map(_told, conflicts)))
    if case.exchange.types_error:
        return Judgement(UNKNOWN, expected, f"the md5 sums are not known: {case.exchange.types_error}")
    return Judgement(OK, expected, "the same types")


def _told(conflict: Conflict) -> str:
    (one, its_type, its_sum), (other, type_name, md5sum) = sorted((conflict.one, conflict.other))
    if its_type != type_name:
        return f"{conflict.topic} is {its_type} on {one} and {type_name} on {other}"
    return f"{conflict.topic} is {type_name} on both, with the md5 sum {its_sum} on {one} and {md5sum} on {other}"


TYPES = Check(
    id="types",
    title="topics have the same type on both sides",
    scope=MASTER,
    judge=_types,
    documented=Documented("pair of roscores", "a topic that is exchanged has one type and one md5 sum on both robots"),
    causes=(
        Cause(
            "the Python of ROS on {observer} does not tell the classes of its message types",
            "try on {observer}: rosmsg md5 std_msgs/String",
            when=_types_unknown,
        ),
        Cause(
            "subscribers and publishers of different types do not connect, so the collection's nodes refuse the topic of the "
            "other robot",
            "install the same version of the message package on both, or give one of the topics another name",
        ),
    ),
)


# The flow

MOST_REGISTRATIONS = 5000  # of one master: the same number as in the nodes' core/limits.py


def _exchange_unknown(case: Case) -> bool:
    return case.exchange is not None and bool(case.exchange.error)


def _superfluous(case: Case) -> bool:
    own, its = case.robots
    return bool(case.exchanges.superfluous(its, own))


def _nothing_registered(case: Case) -> bool:
    own, its = case.robots
    return not case.exchanges.imported(its, own)


def _too_many(case: Case) -> bool:
    """Whether the observer has as much of the other robot as master_sync takes of one."""
    own, its = case.robots
    return len(case.exchanges.imported(its, own)) >= MOST_REGISTRATIONS


def _flow(case: Case) -> Judgement | None:
    if case.exchange is None:
        return None
    own, its = case.robots
    if case.exchange.error:
        return Judgement(UNKNOWN, f"what {its} gives", case.exchange.error)
    missing, superfluous = case.exchanges.missing(its, own), case.exchanges.superfluous(its, own)
    parts = [("not there", missing), ("there against the plan", superfluous)]
    found = "; ".join(f"{words}: {_some(map(str, items))}" for words, items in parts if items)
    return Judgement(FAILED if found else OK, f"what {its} gives to {own}, and nothing else", found or "just that")


FLOW = Check(
    id="flow",
    title="robot has what it is to get, and nothing else",
    scope=MASTER,
    judge=_flow,
    documented=Documented(
        "pair of roscores", "what the one robot is to give is registered at the other, and nothing else of it is", "3.3"
    ),
    explained_by=(
        "target:reachable",
        "observer:services",
        "target:services",
        "master_uri",
        "rpc_port",
        "list_masters",
        "topic_heard",
    ),
    causes=(
        Cause(
            "the sync node on {observer} does not tell what it has registered",
            "see on {observer}: rosservice call /master_sync/get_sync_info",
            when=_exchange_unknown,
        ),
        Cause(
            "the sync node on {observer} or the discovery node on {target} runs with other parameters, or is not one that can leave "
            "this out",
            "run site.yml on both robots; docs/providers.md says what upstream's nodes cannot leave out",
            when=_superfluous,
        ),
        Cause(
            "the sync node on {observer} has registered nothing of {target}",
            "see on {observer}: journalctl -b -u multimaster-sync; rosservice call /master_sync/get_sync_info",
            when=_nothing_registered,
        ),
        Cause(
            "{target} offers more than the 5000 registrations that the sync node on {observer} takes of one master",
            "leave out what nobody needs, by multimaster_filters or multimaster_exports",
            when=_too_many,
        ),
        Cause(
            "the sync node on {observer} has not registered it, or the discovery node on {target} does not serve it",
            "run site.yml on both robots; see on {observer}: journalctl -b -u multimaster-sync",
        ),
    ),
)


# Connections


def _cross_link(case: Case) -> Judgement | None:
    if case.exchange is None or case.exchange.error:
        return None
    crossing = case.exchanges.crossing(case.exchange.connections, *case.robots)
    found = _some(
        f"{link.node} {'hears' if link.direction == 'in' else 'is heard by'} {link.peer} of {link.robot} on {link.topic}"
        for link in crossing
    )
    return Judgement(FAILED if crossing else OK, "only connections of what is exchanged", found or "only such")


CROSS_LINK = Check(
    id="cross_link",
    title="connections only as exchanged",
    scope=MASTER,
    judge=_cross_link,
    documented=Documented("pair of roscores", "nodes of the two robots are connected only by what is exchanged"),
    causes=(
        Cause(
            "they connected before the flow was declared, or the roscore of a third robot, which knows both, has brought them "
            "together",
            "start these nodes again; if it comes back, run site.yml on all robots, so that none of them holds another one's "
            "subscribers",
        ),
    ),
)


# In the order in which one failure can explain the next.
CHECKS = (
    NODES_ANSWER,
    NAMES,
    TYPES,
    FLOW,
    CROSS_LINK,
)
