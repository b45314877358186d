# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The state of the own master, kept by the changes that its roscore reports: records in, states out.

The parts of a state that are as before are the same objects as before.
Free of sockets, threads and clocks.
"""

from dataclasses import replace
from typing import Any, Dict, List, Optional, Tuple

from .differences import PARTS
from .graph import InvalidDocument, Origins, State, build, change_users
from .json_text import unpack_rows
from .messages import KINDS

CHANGES = "rosfleetChanges"  # the method by which a roscore reports its changes,
REFUSED = "/rosfleet_multimaster/refused"  # and how often it has refused something, as if it were a parameter

#: kind -> the types of the fields after it
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
        self.position = ("", 0)  # epoch and revision, for the next question
        self.parameters: Dict[str, Any] = {}
        self.service_uris: Dict[str, str] = {}
        self.node_uris: Dict[str, str] = {}
        self.state = State(uri, name)  # without stamps
        self._types: Dict[str, str] = {}
        self._origins: Dict[Tuple[str, str], str] = {}

    def take_answer(self, answer: Any) -> None:
        """Take an answer of CHANGES. Raises InvalidDocument."""
        if not isinstance(answer, list) or len(answer) != 3 or answer[0] != 1:
            raise InvalidDocument(f"the roscore does not report its changes: {answer!r:.200}")
        epoch, revision, whole, records = answer[2]
        self.position = (epoch, revision)
        if whole or records:
            self.take(whole, unpack_rows(records))

    def take(self, whole: bool, records: Any) -> None:
        """Take records; `whole`: they replace those that are held. Raises InvalidDocument. Unknown kinds are left out."""
        known = _records(records)
        tables: Dict[str, Any] = {kind: {} if whole else dict(getattr(self.state, f"{kind}s")) for kind in KINDS}
        changes: Dict[str, List[Any]] = {"publisher": [], "subscriber": []}
        if whole:
            for table in (self._types, self.node_uris, self.service_uris, self.parameters):
                table.clear()
        for kind, name, *rest in known:
            if kind in changes:
                changes[kind].append((name, *rest))
            else:
                self._take_fact(tables["service"], kind, name, *rest)
        if whole or any(record[0] != "parameter" for record in known):
            tables.update((kind, change_users(tables[kind], changed)) for kind, changed in changes.items())
            endpoints = {f"{kind}s": table for kind, table in tables.items()}
            self._rebuild(replace(self.state, **endpoints, types=self._types))

    def belong(self, origins: Origins) -> None:
        """Learn which nodes are of other masters. It is known as long as they are there with that URI."""
        if origins.items() <= self._origins.items():
            return
        self._origins.update(origins)
        self._rebuild(replace(self.state, types=self._types))

    def _take_fact(self, services: Dict[str, Any], kind: str, name: str, value: Any, uri: str = "") -> None:
        if kind == "service":  # it has one provider
            _set_or_remove(services, name, (value,) if uri else None)
            _set_or_remove(self.service_uris, name, uri or None)
        elif kind == "parameter":
            _set_or_remove(self.parameters, name, value)
        else:
            _set_or_remove(self.node_uris if kind == "node" else self._types, name, value or None)

    def _rebuild(self, graph: State) -> None:
        """Make the state anew. A part that is as before stays the same object."""
        before, known = self.state, self.node_uris.items()
        self._origins = {key: master for key, master in self._origins.items() if key in known}
        now = build(graph, self.node_uris, self.service_uris, self._origins)
        parts = {part: getattr(now, part) for part in PARTS}
        self.state = replace(before, **{part: table for part, table in parts.items() if table != getattr(before, part)})


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
