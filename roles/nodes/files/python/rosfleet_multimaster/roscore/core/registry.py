# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The knowledge of a roscore, as records: one for each thing that was changed. The store keeps them, the feed sends them.

As a row, in the store, a record is a list, its kind first:

    ["publisher", topic, node, URI of the node, there]     ["subscriber", topic, node, URI of the node, there]
    ["listener", parameter, node, URI of the node, there]  a node that gets changes of a parameter
    ["service", service, node, URI of the service, URI of the node, there]
    ["type", topic, type; "" if it is forgotten]           ["node", node, URI; "" if it is gone]
    ["set", parameter, value]                              ["delete", parameter]

A record of another robot has that robot behind it (holdings.py).

Two kinds are sent, and not kept: ["refused", node, URI, why] and ["parameter", parameter, value].
"""

from typing import Any, Callable, Dict, Iterable, List, NamedTuple, Tuple

from ...protocol.messages import NodeKey
from .owners import Owner, Owners, descend, find_place

Row = List[Any]  # a record as it is kept or sent


class Record(NamedTuple):
    """One change. Fields of other kinds are empty."""

    kind: str
    name: str  # of the topic, service, parameter or node
    node: str = ""  # that uses or provides it
    uri: str = ""  # of the node
    place: str = ""  # URI of the service
    value: Any = None  # of the parameter, the type of the topic, or the reason of the refusal
    there: bool = True  # False: the registration has ended
    by: Owner = None  # the other robot that has made it; None for this one

    @property
    def is_there(self) -> bool:
        """True for something that is there from now on, False for something that is gone."""
        return bool(self.value if self.kind == "type" else self.uri if self.kind == "node" else self.there)

    @property
    def row(self) -> Row:
        """The record as it is kept."""
        row = [self.kind, *(getattr(self, field) for field, _type in _FIELDS[self.kind])]
        return row if self.by is None else [*row, self.by]

    @property
    def texts(self) -> Tuple[str, ...]:
        """The names and URIs in a record of a registration, and empty texts. A start asks each of a hundred thousand three times."""
        return self[1:5] if self.kind != "type" else (self.name, self.value)

    @classmethod
    def from_row(cls, row: Any) -> "Record":
        """Read a record that was kept. Raises ValueError if the row is no record."""
        kind = row[0] if isinstance(row, list) and row and isinstance(row[0], str) else ""
        fields = (*_FIELDS[kind], _BY)[: max(0, len(row) - 1)] if kind in KEPT else ()
        if len(fields) < len(_FIELDS.get(kind, (_BY,))) or len(row) != len(fields) + 1:
            raise ValueError("no record")
        if not all(map(isinstance, row[1:], (kind for _name, kind in fields))):
            raise ValueError("no record")
        return cls(kind, **{field: part for (field, _type), part in zip(fields, row[1:])})


USERS = ("publisher", "subscriber", "listener")  # kinds of records about nodes that use something
KEPT = (*USERS, "service", "type", "node", "set", "delete")
_NAME, _BY = ("name", str), ("by", str)
#: kind -> the fields after it in a row, with their types
_FIELDS: Dict[str, Tuple[Tuple[str, type], ...]] = {
    **dict.fromkeys(USERS, (_NAME, ("node", str), ("uri", str), ("there", bool))),
    "service": (_NAME, ("node", str), ("place", str), ("uri", str), ("there", bool)),
    "type": (_NAME, ("value", str)),
    "node": (_NAME, ("uri", str)),
    "set": (_NAME, ("value", object)),
    "delete": (_NAME,),
    "refused": (_NAME, ("uri", str), ("value", str)),
    "parameter": (_NAME, ("value", object)),
}


class Registry:
    """All that a roscore knows, as plain data."""

    def __init__(self) -> None:
        self.facts: Dict[Tuple[str, ...], Record] = {}  # the record of each thing that is there, in their order
        self.parameters: Dict[str, Any] = {}
        self.owners = Owners()  # of the parameters

    def apply(self, record: Record) -> None:
        """Carry out a record. Raises ValueError if a parameter without a name is no mapping."""
        if record.kind == "set":
            self._set_parameter(split_name(record.name), record.value, record.by)
        elif record.kind == "delete":
            self._delete_parameter(split_name(record.name))
        elif not self.is_known(record):
            if record.is_there:
                self.facts[key_of(record)] = record
            else:
                del self.facts[key_of(record)]

    def is_known(self, record: Record) -> bool:
        """True if a record, of anything but a parameter, changes nothing."""
        present = self.facts.get(key_of(record))
        if record.is_there:
            return present is not None and present[:-1] == record[:-1]  # whoever has made it
        if present is None or record.kind != "service":
            return present is None
        return (present.node, present.place) != (record.node, record.place)  # another one has it by now

    def values(self, kind: str) -> Dict[str, str]:
        """Name -> URI of each "node", or topic -> "type"."""
        return {of.name: of.uri if kind == "node" else of.value for of in self.facts.values() if of.kind == kind}

    def exclude(self, is_gone: Callable[[str, str], bool]) -> "Registry":
        """A copy without the nodes for which `is_gone(name, URI)` is true. Topic types and parameters stay."""
        rest = Registry()
        rest.parameters, rest.owners = self.parameters, self.owners
        rest.facts = {
            key: record for key, record in self.facts.items() if record.kind == "type" or not is_gone(*node_of(record))
        }
        return rest

    def parameter(self, name: str) -> Any:
        """The value of a parameter but the root, None if it is not set."""
        parts = split_name(name)
        within, at = descend(self.parameters, parts)
        return within.get(parts[-1]) if at == len(parts) - 1 else None

    def _set_parameter(self, parts: List[str], value: Any, owner: Owner) -> None:
        """As rosmaster does it: each part of the name above the parameter becomes a mapping."""
        if not parts and not isinstance(value, dict):
            raise ValueError("no record")
        self.owners.set(find_place(self.parameters, parts), owner)
        if not parts:
            self.parameters = value
            return
        within = self.parameters
        for part in parts[:-1]:
            if not isinstance(within.get(part), dict):
                within[part] = {}
            within = within[part]
        within[parts[-1]] = value

    def _delete_parameter(self, parts: List[str]) -> None:
        within, at = descend(self.parameters, parts)
        if parts and at == len(parts) - 1:
            within.pop(parts[-1], None)
            self.owners.delete(parts)


def key_of(record: Record) -> Tuple[str, ...]:
    """The thing that a record is about."""
    return (record.kind, record.name, record.node, record.uri) if record.kind in USERS else (record.kind, record.name)


def node_of(record: Record) -> NodeKey:
    """The node in a record about a node, a service, or a user."""
    return record.name if record.kind == "node" else record.node, record.uri


def split_name(name: str) -> List[str]:
    """The parts of the name of a parameter."""
    return [part for part in name.split("/") if part]


def to_feed(records: Iterable[Record]) -> List[Row]:
    """These records as the feed sends them, without those that it does not send."""
    return [row for row in map(_to_feed, records) if row]


def _to_feed(record: Record) -> Row:
    kind = record.kind
    if kind in ("publisher", "subscriber"):
        return [kind, record.name, record.node, record.there]
    if kind == "service":
        return [kind, record.name, record.node, record.place if record.there else ""]
    return record._replace(by=None).row if kind in ("type", "node", "refused", "parameter") else []


def touches(name: str, parameter: str) -> bool:
    """True if a change of the parameter `name` may change `parameter`: it is above, the same, or below."""
    changed, other = split_name(name), split_name(parameter)
    short = min(len(changed), len(other))
    return changed[:short] == other[:short]
