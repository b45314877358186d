# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The state of a master: from the roscore's answers to the document that other masters read, and back.

Locality is decided by origin. Registrations of a node of this robot are of this master and "local", on whichever computer
it runs; registrations of master_sync for another master carry that master's URI and is "remote".
"""

import math
import re
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import chain
from typing import Any, Callable, Dict, Iterable, List, Mapping, NamedTuple, Optional, Sequence, Set, Tuple

from .filters import HIDDEN, NOTHING, Pattern, Rules

LOCAL, REMOTE = "local", "remote"
END = 2**31 - 1  # seconds: the limit of the record of a heartbeat
LONGEST = 1024  # characters of a name or URI
Endpoints = Mapping[str, Tuple[str, ...]]  # topic or service -> nodes
Origins = Mapping[Tuple[str, str], str]  # (node, URI of the node) -> URI of the master that it is of


class InvalidDocument(ValueError):
    """The document is no state of a master; the text names the place."""


class Node(NamedTuple):
    """A node, or a node as the provider of a service, and its origin."""

    uri: Optional[str]  # of the service, if it is its provider
    origin: str
    locality: str


@dataclass(frozen=True)
class State:
    """The state of one master."""

    uri: str
    name: str
    stamp: float = 0.0  # wall clock, when the state was first seen as it is
    local_stamp: float = 0.0  # the same for the registrations of this master
    publishers: Endpoints = field(default_factory=dict)
    subscribers: Endpoints = field(default_factory=dict)
    services: Endpoints = field(default_factory=dict)
    types: Mapping[str, str] = field(default_factory=dict)
    nodes: Mapping[str, Node] = field(default_factory=dict)
    providers: Mapping[str, Node] = field(default_factory=dict)
    left_out: int = 0  # registrations that the master offers besides: too many (sync/core/limits.py)


# From the roscore


def users_of(*tables: Endpoints) -> Set[str]:
    """The nodes in these tables."""
    return set(chain.from_iterable(chain.from_iterable(table.values() for table in tables)))


def change_users(table: Endpoints, changes: Iterable[Tuple[str, str, bool]]) -> Endpoints:
    """A table after changes: (name, node, whether it uses the name). Each name is sorted once: it may have thousands."""
    users: Dict[str, Set[str]] = {}
    for name, node, there in changes:
        nodes = users[name] if name in users else users.setdefault(name, set(table.get(name, ())))
        (nodes.add if there else nodes.discard)(node)
    found = dict(table)
    for name, nodes in users.items():
        found.pop(name, None)
        found.update({name: tuple(sorted(nodes))} if nodes else {})
    return found


def graph_of(empty: State, system_state: Sequence[Any], topic_types: Sequence[Any]) -> State:
    """The state of a master with only its registrations, from the values of getSystemState and getTopicTypes."""
    publishers, subscribers, services = (
        {str(name): tuple(sorted(map(str, nodes))) for name, nodes in part} for part in system_state
    )
    types = {str(topic): str(kind) for topic, kind in topic_types}
    return replace(empty, publishers=publishers, subscribers=subscribers, services=services, types=types)


def build(graph: State, node_uris: Mapping[str, str], service_uris: Mapping[str, str], origins: Origins) -> State:
    """The whole state, without stamps, of one with only registrations. `origins`: the nodes that are of other masters."""

    def describe(node: str, uri: Optional[str]) -> Node:
        origin = origins.get((node, node_uris.get(node, "")), graph.uri)
        return Node(uri, origin, LOCAL if origin == graph.uri else REMOTE)

    names = users_of(graph.publishers, graph.subscribers, graph.services)
    nodes = {node: describe(node, node_uris.get(node)) for node in names}
    providers = {
        service: describe(users[0], service_uris.get(service)) for service, users in graph.services.items() if users
    }
    used = dict(_pick(graph.types, {**graph.publishers, **graph.subscribers}))
    return replace(graph, types=used, nodes=nodes, providers=providers)


def add_stamps(state: State, before: Optional[State], wall: float) -> State:
    """The state with its stamps: `wall` (Unix time, seconds) if it changed, else those from before."""
    wall = max(1.0, wall % END)
    if before is None:
        return replace(state, stamp=wall, local_stamp=wall)
    if replace(state, stamp=before.stamp, local_stamp=before.local_stamp) == before:
        return before
    stamp = wall if abs(wall - before.stamp) > 1e-6 else wall + 1e-5  # a clock may step back to the very same time
    same = local_part(replace(state, stamp=before.stamp, local_stamp=before.local_stamp)) == local_part(before)
    return replace(state, stamp=stamp, local_stamp=before.local_stamp if same else stamp)


def local_part(state: State) -> State:
    """The part of a state that belongs to its own master."""

    def mine(endpoints: Endpoints) -> Dict[str, Tuple[str, ...]]:
        left = {name: tuple(node for node in users if node in nodes) for name, users in endpoints.items()}
        return {name: users for name, users in left.items() if users}

    nodes = {name: node for name, node in state.nodes.items() if node.origin == state.uri}
    return keep_part(state, nodes, mine(state.publishers), mine(state.subscribers), mine(state.services))


def keep_part(
    state: State, nodes: Mapping[str, Node], publishers: Endpoints, subscribers: Endpoints, services: Endpoints
) -> State:
    """The state with only these of its nodes and registrations, and with their data."""
    return replace(
        state,
        publishers=publishers,
        subscribers=subscribers,
        services=services,
        types=dict(_pick(state.types, {**publishers, **subscribers})),
        nodes=nodes,
        providers=dict(_pick(state.providers, services)),
    )


def shareable_part(state: State) -> State:
    """The part of a state that other robots may want: the registrations of its own master, and the foreign publishers that its own subscribers hear.

    Foreign registrations are among these. In a fleet of many robots it is nearly everything that each one has.
    """
    mine = local_part(state)
    if len(mine.nodes) == len(state.nodes):
        return state
    heard = {topic: state.publishers[topic] for topic in mine.subscribers if topic in state.publishers}
    used = users_of(heard)
    return replace(
        mine,
        publishers={**mine.publishers, **heard},
        nodes={name: node for name, node in state.nodes.items() if name in mine.nodes or name in used},
    )


# The data for each caller


@dataclass(frozen=True)
class ExportPolicy:
    """Rules about the data for others. This computer itself gets everything."""

    hidden: Rules = Rules()
    exports: Optional[Mapping[str, Rules]] = None  # by address, "*" for all others; None: everything to everybody

    @classmethod
    def from_parameters(cls, parameters: Mapping[str, Any]) -> "ExportPolicy":
        """The policy in the parameters of master_discovery, which have been checked."""

        def pattern(name: str) -> Pattern:
            value = parameters.get(name) or []
            return Pattern.from_items([value] if isinstance(value, str) else value, name)

        filters = {**HIDDEN, "do_not_sync": "do_not_sync"}
        hidden = Rules(**{rule: pattern(name) for name, rule in filters.items()})
        exports = parameters.get("exports")
        return cls(hidden, None if exports is None else _rules_by_address(exports))

    def view(self, state: State, caller: Optional[str], also: Iterable[Rules] = ()) -> Tuple[State, List[Rules]]:
        """The state and the rules by which a caller (an address; None for this computer) sees it."""
        if caller is None:
            return state, []
        if self.exports is None:
            return state, [self.hidden, *also]
        return local_part(state), [self.hidden, self.exports.get(caller, self.exports["*"]), *also]


def _rules_by_address(entries: Sequence[Mapping[str, Any]]) -> Dict[str, Rules]:
    """The rules for each address that is named, and for all others."""
    addresses = dict.fromkeys(["*", *(address for entry in entries for address in entry["to"])])
    return {
        address: _export_rules([entry for entry in entries if "*" in entry["to"] or address in entry["to"]])
        for address in addresses
    }


def _export_rules(entries: Sequence[Mapping[str, Any]]) -> Rules:
    topics, services = (
        Pattern.from_items([item for entry in entries for item in entry.get(what, ())], what)
        for what in ("topics", "services")
    )
    return Rules(sync_topics=topics or NOTHING, sync_services=services or NOTHING)


def local_types(state: State, rules: Iterable[Rules] = ()) -> Set[str]:
    """The types that own nodes have named, of topics that the rules want.

    The roscore keeps the type that the last publisher named. If there are only imported publishers, that is one of theirs.
    """
    mine = local_part(state)
    _stamp, _local, _uri, _name, publishers, subscribers = document(mine, rules)[:6]
    topics = {topic for topic, _nodes in publishers}
    topics |= {topic for topic, _nodes in subscribers if topic in mine.publishers or topic not in state.publishers}
    return {state.types[topic] for topic in topics if topic in state.types}


# The document


def stamp_text(stamp: float) -> str:
    """A stamp as masterInfo and masterContacts write it."""
    return f"{stamp:.9f}"


def document(state: State, rules: Iterable[Rules] = ()) -> List[Any]:
    """The ten elements of masterInfo. A thing that any of the rules refuses is left out."""
    every = list(rules)

    def admits_topic(publisher: bool, node: str, topic: str) -> bool:
        return all(rule.topic(node, topic, state.types.get(topic, ""), publisher) for rule in every)

    def admits_service(node: str, service: str) -> bool:
        return all(rule.service(node, service) for rule in every)

    publishers = _select_allowed(state.publishers, partial(admits_topic, True))
    subscribers = _select_allowed(state.subscribers, partial(admits_topic, False))
    provided = _select_allowed(state.services, admits_service)
    names = dict.fromkeys(name for name, _nodes in publishers + subscribers)
    used = dict.fromkeys(node for _name, nodes in publishers + subscribers + provided for node in nodes)
    return [
        stamp_text(state.stamp),
        stamp_text(state.local_stamp),
        state.uri,
        state.name,
        publishers,
        subscribers,
        provided,
        [[topic, state.types[topic]] for topic in names if topic in state.types],
        [[name, node.uri, node.origin, None, node.locality] for name, node in _pick(state.nodes, used)],
        [
            [name, node.uri, node.origin, "", node.locality]
            for name, node in _pick(state.providers, (service for service, _nodes in provided))
        ],
    ]


def _select_allowed(endpoints: Endpoints, allows: Callable[[str, str], bool]) -> List[List[Any]]:
    """The names with those of their nodes that are allowed; names without any are left out."""
    left = ([name, [node for node in users if allows(node, name)]] for name, users in endpoints.items())
    return [entry for entry in left if entry[1]]


def _pick(table: Mapping[str, Any], names: Iterable[str]) -> List[Tuple[str, Any]]:
    return [(name, table[name]) for name in names if name in table]


def parse(value: Any) -> State:
    """The state in a document from another computer. Raises InvalidDocument."""
    if not isinstance(value, (list, tuple)) or len(value) != 10:
        raise InvalidDocument("not an array of ten elements")
    try:
        stamp, local_stamp = float(value[0]), float(value[1])
    except (TypeError, ValueError, OverflowError):
        raise InvalidDocument("its stamps are no numbers") from None
    if not (abs(stamp) < math.inf and abs(local_stamp) < math.inf):
        raise InvalidDocument("its stamps are no times")
    uri, name = _text(value[2], "the URI"), _text(value[3], "the name")
    return State(
        uri=uri,
        name=name,
        stamp=stamp,
        local_stamp=local_stamp,
        publishers=_endpoints(value[4], "publishers"),
        subscribers=_endpoints(value[5], "subscribers"),
        services=_endpoints(value[6], "services"),
        types={
            topic: kind
            for topic, kind in _rows(value[7], 2, "topic types", "a topic")
            if VISIBLE.match(_text(kind, "a type"))
        },
        nodes=_nodes(_rows(value[8], 5, "nodes", "a node"), "http://"),
        providers=_providers(_rows(value[9], 5, "service providers", "a service")),
    )


VISIBLE = re.compile(r"[!-~]{1,255}\Z")  # the signs of types and URIs,
NAME = re.compile(r"/[!-~]{1,254}\Z")  # and names: others are left out, since one odd name must not stop an exchange


def _rows(value: Any, width: int, what: str, name: str) -> List[Any]:
    """The rows of a table, without those whose first element is no name."""
    if not isinstance(value, (list, tuple)) or any(
        not isinstance(row, (list, tuple)) or len(row) != width for row in value
    ):
        raise InvalidDocument(f"its {what} are no array of arrays of {width}")
    return [row for row in value if NAME.match(_text(row[0], name))]


def _text(value: Any, what: str) -> str:
    if not isinstance(value, str) or len(value) > LONGEST:
        raise InvalidDocument(f"{what} is no text of at most {LONGEST} characters")
    return value


def _uri(value: Any, scheme: str) -> Optional[str]:
    return value if isinstance(value, str) and value.startswith(scheme) and VISIBLE.match(value) else None


def _nodes(rows: List[Any], scheme: str) -> Dict[str, Node]:
    """The nodes in rows, with URIs of this scheme. The fourth element is not kept: a process, or the type of a service."""
    return {
        name: Node(_uri(where, scheme), _text(origin, "an origin"), _text(locality, "a locality"))
        for name, where, origin, _more, locality in rows
    }


def _providers(rows: List[Any]) -> Dict[str, Node]:
    """The providers of services in rows."""
    for row in rows:
        _text(row[3], "a type")
    return _nodes(rows, "rosrpc://")


def _endpoints(value: Any, what: str) -> Dict[str, Tuple[str, ...]]:
    found = {}
    for name, nodes in _rows(value, 2, what, what):
        if not isinstance(nodes, (list, tuple)):
            raise InvalidDocument(f"the nodes of {what} are no array")
        found[name] = tuple(node for node in nodes if NAME.match(_text(node, "a node")))
    return found
