# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Differences between two states of a master, as far as a caller may see them.

The serving side remembers the rows that each change replaced (`History`). So it knows the former and the present state of the
names that changed (`excerpt`). It makes the document of both by the rules of the caller, as it makes every document, and
gives their difference (`difference`). Hidden rows are in neither, so it is in no difference.

The asking side replaces the rows that it gets (`applied`). Types, nodes and providers go with who used them.
Free of sockets, threads and clocks.
"""

import hashlib
import json
from collections import deque
from dataclasses import replace
from itertools import islice
from typing import Any, Callable, Deque, Dict, Iterable, List, Mapping, NamedTuple, Optional, Sequence, Set

from .graph import InvalidDocument, State, add_stamps, document, parse, users_of

DIFFERENCES = "rosfleetDifferences"
PACKED = "rosfleetDifferencesPacked"  # the same, its answers as texts of JSON
PARTS = ("publishers", "subscribers", "services", "types", "nodes", "providers")  # of a state, as in its document
_FIRST = 4  # element of the document that is the first part
_USED = 3  # parts with names that are used; the other ones say more about them
MOST_NAMES, MOST_RECORDS = 20_000, 1_000  # of a history

Undo = Mapping[str, Mapping[str, Any]]  # part -> name -> the former value, None if it was not there


class Names(NamedTuple):
    """The topics and services that a change is about."""

    topics: Set[str]
    services: Set[str]


class Difference(NamedTuple):
    """The rows that are new or others, as a document, and the names that are gone: publishers, subscribers, services."""

    document: List[Any]
    gone: List[List[str]]

    def __bool__(self) -> bool:
        return any(self.document[_FIRST:]) or any(self.gone)


# Two states


def changes(before: State, after: State) -> Dict[str, Dict[str, Any]]:
    """The changes: part -> name -> the former value. Quick if both states share their parts."""
    found = {}
    for part in PARTS:
        old, new = getattr(before, part), getattr(after, part)
        if old is new:
            continue
        changed = {name: old.get(name) for name, _row in old.items() ^ new.items()}
        if changed:
            found[part] = changed
    return found


def names_of(undo: Undo, after: State) -> Names:
    """The names that changes are about, those of nodes that became others too."""
    topics = {name for part in ("publishers", "subscribers", "types") for name in undo.get(part, ())}
    services = {name for part in ("services", "providers") for name in undo.get(part, ())}
    moved = {node for node, was in undo.get("nodes", {}).items() if was is not None and node in after.nodes}
    if moved:
        for table, names in ((after.publishers, topics), (after.subscribers, topics), (after.services, services)):
            names.update(name for name, users in table.items() if not moved.isdisjoint(users))
    return Names(topics, services)


def excerpt(state: State, names: Names, undo: Undo) -> State:
    """The part of a state about some names; with an undo, as it was before."""

    def pick(part: str, wanted: Iterable[str]) -> Dict[str, Any]:
        now, was = getattr(state, part), undo.get(part, {})
        rows = ((name, was[name] if name in was else now.get(name)) for name in sorted(wanted))
        return {name: row for name, row in rows if row is not None}

    publishers, subscribers = pick("publishers", names.topics), pick("subscribers", names.topics)
    services = pick("services", names.services)
    return replace(
        state,
        publishers=publishers,
        subscribers=subscribers,
        services=services,
        types=pick("types", names.topics),
        nodes=pick("nodes", users_of(publishers, subscribers, services)),
        providers=pick("providers", names.services),
    )


class Stamps:
    """The stamps of the states of one master, one state after the other."""

    def __init__(self) -> None:
        self.last: Optional[State] = None

    def stamp(self, state: State, wall: float) -> State:
        """The state with its stamps (see graph.add_stamps); the one before if nothing has changed."""
        self.last = add_stamps(state, self.last, wall)
        return self.last


# The serving side


class History:
    """The rows that the latest changes replaced, as far back as there is room."""

    def __init__(self) -> None:
        self.revision = 1
        self._records: Deque[Undo] = deque()  # the rows that each change replaced; the last one is that of `revision`
        self._size = 0

    def add(self, undo: Undo) -> None:
        """Note a change. One that replaced nothing has a number, too: stamps may be others."""
        self.revision += 1
        self._records.append(undo)
        self._size += _size(undo)
        while self._size > MOST_NAMES or len(self._records) > MOST_RECORDS:
            self._size -= _size(self._records.popleft())

    def undo_since(self, revision: int) -> Optional[Undo]:
        """The rows that all changes after this one replaced; None if it is not known any more."""
        if revision > self.revision or revision < self.revision - len(self._records):
            return None
        merged: Dict[str, Dict[str, Any]] = {}
        for undo in islice(reversed(self._records), self.revision - revision):
            for part, rows in undo.items():
                merged.setdefault(part, {}).update(rows)
        return merged


def _size(undo: Undo) -> int:
    return sum(map(len, undo.values()))


def difference_in_view(state: State, undo: Undo, view: Callable[[State], Sequence[Any]]) -> Optional[Difference]:
    """The meaning of changes to a caller who sees a state as `view(state)`, a document; None if it takes the whole."""
    names = names_of(undo, state)
    return difference(view(excerpt(state, names, undo)), view(excerpt(state, names, {})))


def difference(before: Sequence[Any], after: Sequence[Any]) -> Optional[Difference]:
    """The difference of two documents. None if that cannot be described: something is gone, and who used it is not."""
    rows_told: List[Any] = list(after[:_FIRST])
    gone: List[List[str]] = []
    used: Set[str] = set()
    for number, (old_rows, rows) in enumerate(zip(before[_FIRST:], after[_FIRST:])):
        old, new = {row[0]: row for row in old_rows}, {row[0] for row in rows}
        rows_told.append([row for row in rows if old.get(row[0]) != row])
        lost = [name for name in old if name not in new]
        if number < _USED:
            gone.append(lost)
            used.update(new, (node for _name, nodes in rows for node in nodes))
        elif not used.isdisjoint(lost):
            return None
    return Difference(rows_told, gone)


def empty_difference(state: State) -> Difference:
    """An answer without any change."""
    nothing = State(state.uri, state.name, state.stamp, state.local_stamp)
    return Difference(document(nothing), [[] for _part in PARTS[:_USED]])


def digest(state: State) -> str:
    """A text that differs if the states differ in the data that travels; the stamps do not matter."""
    found = hashlib.sha256()
    for part in PARTS:
        table = getattr(state, part)
        for name in sorted(table):
            found.update(json.dumps([part, name, table[name]]).encode())
    return found.hexdigest()[:32]


# The asking side


def apply_difference(state: State, document: Any, gone: Any) -> State:
    """The state after a difference. Raises InvalidDocument."""
    new = parse(document)
    if new.uri != state.uri:
        raise InvalidDocument(f"it is about {new.uri}, and not about {state.uri}")
    lost = _parse_gone(gone)
    tables: Dict[str, Any] = {}
    for number, part in enumerate(PARTS):
        away = {
            row[0] for row in document[_FIRST + number]
        }  # also rows that are not taken, such as those with an odd type
        away.update(lost[number] if number < _USED else ())
        tables[part] = _merge_rows(getattr(state, part), getattr(new, part), away)
    if any(lost) or any(tables[part] is not getattr(state, part) for part in PARTS[:_USED]):
        _tidy(tables)
    return replace(state, name=new.name, stamp=new.stamp, local_stamp=new.local_stamp, **tables)


def _tidy(tables: Dict[str, Any]) -> None:
    """Leave out the types, nodes and providers that are not used any more."""
    endpoints = [tables[part] for part in PARTS[:_USED]]
    topics = endpoints[0].keys() | endpoints[1].keys()
    for part, used in (("types", topics), ("nodes", users_of(*endpoints)), ("providers", endpoints[2].keys())):
        if not tables[part].keys() <= used:
            tables[part] = {name: row for name, row in tables[part].items() if name in used}


def _merge_rows(before: Mapping[str, Any], new: Mapping[str, Any], away: Set[str]) -> Mapping[str, Any]:
    """The rows with the new ones in their place; the same object if no row changes."""
    away = {name for name in away if name in before and name not in new}
    others = {name: row for name, row in new.items() if before.get(name) != row}
    if not others and not away:
        return before
    merged = {**before, **others}
    for name in away:
        del merged[name]
    return merged


def _parse_gone(value: Any) -> List[Set[str]]:
    if not isinstance(value, list) or len(value) != _USED:
        raise InvalidDocument("the list of withdrawn names is no array of three")
    if not all(isinstance(names, list) and all(isinstance(name, str) for name in names) for names in value):
        raise InvalidDocument("the withdrawn names are no arrays of names")
    return [set(names) for names in value]
