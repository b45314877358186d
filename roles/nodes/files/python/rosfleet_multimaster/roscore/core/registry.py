# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The knowledge of a roscore, as records: one for each thing that was changed. The store keeps them, the feed tells them.

A record is a list, its kind first:

    ["publisher", topic, node, URI of the node, there]     ["subscriber", topic, node, URI of the node, there]
    ["listener", parameter, node, URI of the node, there]  a node that is told changes of a parameter
    ["service", service, node, URI of the service, URI of the node, there]
    ["type", topic, type; "" where it is forgotten]        ["node", node, URI; "" where it is gone]
    ["set", parameter, value]                              ["delete", parameter]
"""

from typing import Any, Callable, Dict, Iterable, List, Sequence, Tuple

from ...protocol.messages import NodeKey

Record = List[Any]


USERS = ("publisher", "subscriber", "listener")  # kinds of records about nodes that use something
#: kind -> the types of what follows it
_TYPES: Dict[str, Tuple[type, ...]] = {
    **dict.fromkeys(USERS, (str, str, str, bool)),
    "service": (str, str, str, str, bool),
    "type": (str, str),
    "node": (str, str),
    "set": (str, object),
    "delete": (str,),
}


class Registry:
    """All that a roscore knows, as plain data."""

    def __init__(self) -> None:
        self.facts: Dict[Tuple[str, ...], Record] = {}  # the record of each thing that is there, in their order
        self.parameters: Dict[str, Any] = {}

    def apply(self, record: Record) -> None:
        """Carry out a record. Raises ValueError where it is malformed."""
        self.check(record)
        if record[0] == "set":
            self._set_parameter(split_name(record[1]), record[2])
        elif record[0] == "delete":
            self._delete_parameter(split_name(record[1]))
        elif not self.is_known(record):
            if record[-1]:
                self.facts[_key(record)] = record
            else:
                del self.facts[_key(record)]

    @staticmethod
    def check(record: Any) -> None:
        """Raise ValueError where this is no record."""
        kinds = _TYPES.get(record[0]) if isinstance(record, list) and record and isinstance(record[0], str) else None
        if kinds is None or len(record) != len(kinds) + 1 or not all(map(isinstance, record[1:], kinds)):
            raise ValueError("no record")

    def is_known(self, record: Record) -> bool:
        """True where a record, of anything but a parameter, changes nothing."""
        present = self.facts.get(_key(record))
        if record[-1]:
            return present == record
        return present is None or (record[0] == "service" and present[:4] != record[:4])  # another one has it by now

    def values(self, kind: str) -> Dict[str, str]:
        """Name -> URI of each "node", or topic -> "type"."""
        return {record[1]: record[2] for record in self.facts.values() if record[0] == kind}

    def exclude(self, is_gone: Callable[[str, str], bool]) -> "Registry":
        """A copy without the nodes for which `is_gone(name, URI)` is true. Topic types and parameters stay."""
        rest = Registry()
        rest.parameters = self.parameters
        rest.facts = {
            key: record for key, record in self.facts.items() if record[0] == "type" or not is_gone(*node_of(record))
        }
        return rest

    def parameter(self, name: str) -> Any:
        """The value of a parameter but the root, None where it is not set."""
        parts = split_name(name)
        within, at = descend(self.parameters, parts)
        return within.get(parts[-1]) if at == len(parts) - 1 else None

    def _set_parameter(self, parts: List[str], value: Any) -> None:
        """As rosmaster does it: each part of the name above the parameter becomes a mapping."""
        if not parts:
            if not isinstance(value, dict):
                raise ValueError("no record")
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


def _key(record: Record) -> Tuple[str, ...]:
    """The thing that a record is about."""
    return tuple(record[: 4 if record[0] in USERS else 2])


def node_of(record: Record) -> NodeKey:
    """The node in a record about a node, a service, or a user."""
    if record[0] == "service":
        return record[2], record[4]
    at = 2 if record[0] in USERS else 1
    return record[at], record[at + 1]


def split_name(name: str) -> List[str]:
    """The parts of the name of a parameter."""
    return [part for part in name.split("/") if part]


def descend(tree: Dict[str, Any], parts: Sequence[str]) -> Tuple[Dict[str, Any], int]:
    """The innermost mapping on the way to a parameter, and the place of the part that is looked up in it."""
    for at, part in enumerate(parts[:-1]):
        inner = tree.get(part)
        if not isinstance(inner, dict):
            return tree, at
        tree = inner
    return tree, len(parts) - 1


def to_feed(records: Iterable[Record]) -> List[Record]:
    """These records as the feed tells them, without those that it does not tell."""
    return [record for record in map(_to_feed, records) if record]


def _to_feed(record: Record) -> Record:
    kind = record[0]
    if kind in ("publisher", "subscriber"):
        return [kind, record[1], record[2], record[4]]
    if kind == "service":
        return [kind, record[1], record[2], record[3] if record[5] else ""]
    return record if kind in ("type", "node", "refused", "parameter") else []


def touches(name: str, parameter: str) -> bool:
    """True where a change of the parameter `name` may change `parameter`: it is above, the same, or below."""
    changed, other = split_name(name), split_name(parameter)
    short = min(len(changed), len(other))
    return changed[:short] == other[:short]
