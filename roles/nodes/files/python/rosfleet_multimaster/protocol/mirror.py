# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The state of the own master, kept by what its roscore tells: records in, states out.

Only what a record is about is made anew; all other parts of a state are those of the one before, the same objects.
Free of sockets, threads and clocks.
"""

from collections import Counter
from dataclasses import replace
from typing import Any, Dict, List, Mapping, Optional, Set, Tuple
from typing import Counter as Counts

from .graph import LOCAL, REMOTE, InvalidDocument, Node, Origins, Provider, State

CHANGES = "rosfleetChanges"  # the method by which a roscore tells its changes,
REFUSED = "/rosfleet_multimaster/refused"  # and how often it has refused something, as if it were a parameter

_ENDPOINTS = {"publisher": "publishers", "subscriber": "subscribers", "service": "services"}
#: kind -> the types of what follows it
_TYPES = {
    "publisher": (str, str, bool),
    "subscriber": (str, str, bool),
    "service": (str, str, str),
    "type": (str, str),
    "node": (str, str),
    "parameter": (str, object),
}


class Mirror:
    """The registrations of a roscore."""

    def __init__(self, uri: str, name: str) -> None:
        """`uri` and `name` are those of the master."""
        self.parameters: Dict[str, Any] = {}
        self.service_uris: Dict[str, str] = {}
        self.node_uris: Dict[str, str] = {}
        self._state = State(uri, name)
        self._types: Dict[str, str] = {}
        self._uses: Counts[str] = Counter()  # by node: its topics and services
        self._origins: Dict[Tuple[str, str], str] = {}

    def take(self, whole: bool, records: Any) -> None:
        """Take records; `whole`: they replace what is held. Raises InvalidDocument. Unknown kinds are left out."""
        tables = {part: {} if whole else dict(getattr(self._state, part)) for part in _ENDPOINTS.values()}
        if whole:
            for table in (self._types, self.node_uris, self.service_uris, self._uses, self.parameters):
                table.clear()
        touched: Set[str] = set()  # topics
        kinds: Set[str] = set()
        for record in _records(records):
            kind, name = record[:2]
            kinds.add(kind)
            if kind in _ENDPOINTS:
                self._endpoint(tables[_ENDPOINTS[kind]], kind, record)
            elif kind == "node":
                _set_or_remove(self.node_uris, name, record[2] or None)
            elif kind == "type":
                _set_or_remove(self._types, name, record[2] or None)
            else:
                _set_or_remove(self.parameters, name, record[2])
            touched.add(name)
        if whole:  # what is not among the records is gone
            self._state = State(self._state.uri, self._state.name)
            kinds.update(_ENDPOINTS)
        self._rebuild(tables, kinds, touched)

    def belong(self, origins: Origins) -> None:
        """Learn which nodes are of other masters. It is known as long as they are there with that URI."""
        if origins.items() <= self._origins.items():
            return
        self._origins.update(origins)
        self._rebuild({}, {"node"}, set())

    def uri_of(self, node: str) -> str:
        """The URI of a node; empty where it is not known."""
        return self.node_uris.get(node, "")

    def is_local(self, node: str) -> bool:
        """True where a node is of this master."""
        return self._origin(node) == self._state.uri

    def _origin(self, node: str) -> str:
        return self._origins.get((node, self.uri_of(node)), self._state.uri)

    def state(self) -> State:
        """The state now, without stamps."""
        return self._state

    def _endpoint(self, table: Dict[str, Tuple[str, ...]], kind: str, record: List[Any]) -> None:
        _kind, name, node, there = record
        users = set(table.get(name, ()))
        before = len(users)
        if kind == "service":
            users.clear()  # it has one provider
            self._count(table.get(name, ()), -1)
            _set_or_remove(self.service_uris, name, there or None)
            before = 0
        (users.add if there else users.discard)(node)
        self._count((node,), len(users) - before)
        _set_or_remove(table, name, tuple(sorted(users)) or None)

    def _count(self, nodes: Any, by: int) -> None:
        for node in nodes:
            self._uses[node] += by
            if not self._uses[node]:
                del self._uses[node]

    def _rebuild(self, tables: Dict[str, Any], kinds: Set[str], topics: Set[str]) -> None:
        """Make the state anew, where these kinds of records came, about these topics among others."""
        parts = {part: table for part, table in tables.items() if part[:-1] in kinds}
        endpoints = {part: parts.get(part, getattr(self._state, part)) for part in _ENDPOINTS.values()}
        if kinds & {"publisher", "subscriber", "type"}:
            parts["types"] = self._used_types(endpoints, topics)
        if kinds & {"publisher", "subscriber", "service", "node"}:
            known = set(self.node_uris.items())
            self._origins = {key: master for key, master in self._origins.items() if key in known}
            parts["nodes"] = {node: self._node(node) for node in self._uses}
            parts["providers"] = {name: self._provider(name, users) for name, users in endpoints["services"].items()}
        self._state = replace(
            self._state, **{part: table for part, table in parts.items() if table != getattr(self._state, part)}
        )

    def _used_types(self, endpoints: Mapping[str, Any], topics: Set[str]) -> Dict[str, str]:
        """The types of the topics that somebody has. Only these ones may be others than before."""
        found = dict(self._state.types)
        for topic in topics:
            used = topic in endpoints["publishers"] or topic in endpoints["subscribers"]
            _set_or_remove(found, topic, self._types.get(topic) if used else None)
        return found

    def _node(self, node: str) -> Node:
        of = self._origin(node)
        return Node(self.node_uris.get(node), of, LOCAL if of == self._state.uri else REMOTE)

    def _provider(self, name: str, users: Tuple[str, ...]) -> Provider:
        of = self._origin(users[0])
        return Provider(self.service_uris.get(name), of, LOCAL if of == self._state.uri else REMOTE)


def _set_or_remove(table: Dict[str, Any], name: str, value: Optional[Any]) -> None:
    if value is None:
        table.pop(name, None)
    else:
        table[name] = value


def _records(records: Any) -> List[List[Any]]:
    if not isinstance(records, (list, tuple)):
        raise InvalidDocument("the records are no array")
    known: List[List[Any]] = []
    for record in records:
        if not isinstance(record, (list, tuple)) or not record:
            continue
        if not isinstance(record[0], str):
            raise InvalidDocument("the kind of a record is no text")
        kind, *rest = record
        if kind == "parameter" and len(rest) == 1:  # it is not set
            rest.append(None)
        types = _TYPES.get(kind)
        if types is not None:
            if len(rest) != len(types) or not all(map(isinstance, rest, types)):
                raise InvalidDocument(f"a record of the kind {kind} is malformed")
            known.append([kind, *rest])
    return known
