# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""A small plan for a few registrations, from the knowledge of the last round. If that is not enough, a round follows.

A round reads the whole roscore, and all registrations of all masters. With 3,000 topics, or if twenty robots meet,
that takes longer than everything else. Most changes are simple: a node of another robot has one topic more or less, or a
robot comes with topics that no other robot has. `step` plans only these, and gives the same plan as a round. Before
anything is written, the roscore is asked whether the names are still free (`condition_of`). Free of sockets, threads and clocks.
"""

from dataclasses import replace
from typing import Callable, Container, Dict, List, Mapping, NamedTuple, Optional, Sequence, Set, Tuple

from ...protocol.filters import UNKNOWN_TYPES
from ...protocol.graph import change_users
from ...protocol.imports import Claims
from ...protocol.messages import KINDS, NodeKey, Registration, View
from .sync import Candidate, SyncPlan, nodes_of


class Knowledge(NamedTuple):
    """The knowledge since the last round."""

    view: View
    claims: Claims
    held: Mapping[Registration, str]
    refused: Container[str]  # names of nodes, services and topics with a refusal


Condition = Dict[Tuple[str, str], Optional[str]]  # call of the roscore -> the URI that it must answer; None: no URI


def step(
    touched: Set[Registration],
    wanted: Mapping[Registration, Candidate],
    known: Knowledge,
    is_contested: Callable[[str, str], bool],
) -> Optional[SyncPlan]:
    """The plan for the registrations that may have changed; None if it takes a round.

    `wanted`: those of them that are wanted now. `is_contested(node or service, master)`: true if another master has the name.
    """
    if not _is_as_before(touched, wanted, known):
        return None
    new = sorted(item for item in wanted if item not in known.held)
    old = sorted(item for item in touched if item not in wanted and item in known.held)
    masters = {item: wanted[item].master_uri for item in new}
    claimed = dict(known.claims.keys())
    if not _are_simple(new + old, known.view, claimed):
        return None
    if not all(_is_free(item, masters[item], known) for item in new):
        return None
    if any(is_contested(*name) for name in _names_of(masters)):
        return None
    return _plan(new, old, wanted, known)


def _plan(
    new: List[Registration], old: List[Registration], wanted: Mapping[Registration, Candidate], known: Knowledge
) -> SyncPlan:
    held = dict(known.held)
    for item in old:
        del held[item]
    held.update((item, wanted[item].master_uri) for item in new)
    nodes = nodes_of(held) if old else set()
    claims = {key: master for key, master in known.claims.items() if not old or key in nodes}
    claims.update((item.node_key, wanted[item].master_uri) for item in new)
    return SyncPlan(claims, old, new, held, [], {item: wanted[item].type for item in new})


def _is_as_before(touched: Set[Registration], wanted: Mapping[Registration, Candidate], known: Knowledge) -> bool:
    """True if these names have no refusal, and registered topics still have the type that their master names."""
    if any(item.name in known.refused or item.node in known.refused for item in touched):
        return False
    held = ((item, wanted[item].type) for item in wanted if item in known.held and item.kind != "service")
    return all(kind in UNKNOWN_TYPES or known.view.types.get(item.name, kind) == kind for item, kind in held)


def _are_simple(items: Sequence[Registration], view: View, claimed: Mapping[str, str]) -> bool:
    """True if no own node uses their names. `claimed`: node of another master -> its URI."""
    topics = {item.name for item in items if item.kind != "service"}  # each once: thousands of nodes may be on one
    tables = (view.publishers, view.subscribers)
    return all(_is_simple(item, view, claimed) for item in items) and all(
        claimed.keys() >= {*table.get(topic, ())} for table in tables for topic in topics
    )


def _is_simple(item: Registration, view: View, claimed: Mapping[str, str]) -> bool:
    """True if no own node has the name of its node, or of its service."""
    if claimed.get(item.node, item.node_uri) != item.node_uri:
        return False
    if view.node_uris.get(item.node, item.node_uri) != item.node_uri:  # an own node has its name
        return False
    users = view.services.get(item.name, ()) if item.kind == "service" else ()
    return all(user == item.node and user in claimed for user in users)


def _is_free(item: Registration, master: str, known: Knowledge) -> bool:
    """True if its names are not registered for another master."""
    if item.kind == "service" and item.name in known.view.services:
        return False
    return known.claims.get(item.node_key, master) == master


def _names_of(masters: Mapping[Registration, str]) -> Set[Tuple[str, str]]:
    """The names of nodes and services, each once with its master: a node has many topics."""
    nodes = {(item.node, master) for item, master in masters.items()}
    return nodes | {(item.name, master) for item, master in masters.items() if item.kind == "service"}


def condition_of(todo: SyncPlan, claims: Mapping[NodeKey, str], guarded: bool) -> Condition:
    """The condition for a plan: its names have not been taken meanwhile, and its nodes have not moved.

    `guarded`: the roscore itself guards the names of nodes.
    """
    services: Condition = {("lookupService", item.name): None for item in todo.register if item.kind == "service"}
    if guarded:
        return services
    nodes: Condition = {
        ("lookupNode", item.node): item.node_uri if item.node_key in claims else None for item in todo.register
    }
    return {**services, **nodes}


def apply_plan(todo: SyncPlan, view: View) -> View:
    """The registrations of the roscore after a plan."""
    items = (*todo.unregister, *todo.register)
    tables = {
        f"{kind}s": change_users(
            getattr(view, f"{kind}s"),
            ((item.name, item.node, item in todo.held) for item in items if item.kind == kind),
        )
        for kind in KINDS
    }
    node_uris = {**view.node_uris, **{item.node: item.node_uri for item in items if item in todo.held}}
    service_uris = dict(view.service_uris)
    service_uris.update((item.name, item.service_uri) for item in items if item.kind == "service" and item in todo.held)
    types = {**view.types, **{item.name: kind for item, kind in todo.types.items() if item.kind == "publisher"}}
    return replace(view, **tables, node_uris=node_uris, service_uris=service_uris, types=types)
