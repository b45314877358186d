# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The knowledge of a roscore, as records: one for each thing that was changed. The store keeps them, the feed tells of them.

A record is a list, its kind first:

    ["publisher", topic, node, URI of the node, there]     ["subscriber", topic, node, URI of the node, there]
    ["listener", parameter, node, URI of the node, there]  who hears of changes of a parameter
    ["service", service, node, URI of the service, URI of the node, there]
    ["type", topic, type]                                  ["node", node, URI; "" where it is gone]
    ["set", parameter, value]                              ["delete", parameter]
"""

from typing import Any, Callable, Dict, Iterable, Iterator, List, NamedTuple, Optional, Tuple

Record = List[Any]
Of = Tuple[str, str]  # a node: its name and its URI


class Service(NamedTuple):
    """Who provides a service, and where."""

    node: str
    node_uri: str
    uri: str


class Registry:
    """All that a roscore knows, as plain data."""

    def __init__(self) -> None:
        self.publishers: Dict[str, Dict[Of, None]] = {}  # each a set that keeps the order
        self.subscribers: Dict[str, Dict[Of, None]] = {}
        self.listeners: Dict[str, Dict[Of, None]] = {}
        self.services: Dict[str, Service] = {}
        self.types: Dict[str, str] = {}
        self.nodes: Dict[str, str] = {}
        self.parameters: Dict[str, Any] = {}

    def apply(self, record: Record) -> None:
        """Carry out what a record says. Raises ValueError where it says nothing."""
        self.check(record)
        try:
            _APPLY[record[0]](self, *record[1:])
        except (KeyError, TypeError, IndexError):
            raise ValueError("no record") from None

    @staticmethod
    def check(record: Any) -> None:
        """Raise ValueError where this is no record."""
        kinds = _TYPES.get(record[0]) if isinstance(record, list) and record and isinstance(record[0], str) else None
        if kinds is None or len(record) != len(kinds) + 1 or not all(map(isinstance, record[1:], kinds)):
            raise ValueError("no record")

    def now(self, record: Record) -> Record:
        """The same record as it is now: of a registration, with its presence; of a type or node, with what it is."""
        kind, key, *rest = record
        if kind in ("publisher", "subscriber", "listener"):
            return [*record[:4], tuple(rest[:2]) in getattr(self, f"{kind}s").get(key, {})]
        if kind == "service":
            held = self.services.get(key)
            there = held is not None and (held.node, held.uri) == tuple(rest[:2])
            return [kind, key, *rest[:2], held.node_uri if held and there else rest[2], there]
        return [kind, key, (self.types if kind == "type" else self.nodes).get(key, "")]

    def records(self) -> Iterator[Record]:
        """The records that make this registry out of an empty one."""
        yield ["set", "/", self.parameters]
        for topic, kind in self.types.items():
            yield ["type", topic, kind]
        for node, uri in self.nodes.items():
            yield ["node", node, uri]
        for name, table in (
            ("publisher", self.publishers),
            ("subscriber", self.subscribers),
            ("listener", self.listeners),
        ):
            for key, users in table.items():
                for node, uri in users:
                    yield [name, key, node, uri, True]
        for service, of in self.services.items():
            yield ["service", service, of.node, of.uri, of.node_uri, True]

    def without(self, gone: Callable[[str, str], bool]) -> "Registry":
        """The same without the nodes for which `gone(name, URI)` is true. Topic types and parameters stay."""
        left = Registry()
        left.types, left.parameters = self.types, self.parameters
        left.nodes = {node: uri for node, uri in self.nodes.items() if not gone(node, uri)}
        for name in ("publishers", "subscribers", "listeners"):
            for key, users in getattr(self, name).items():
                some = {of: None for of in users if not gone(*of)}
                if some:
                    getattr(left, name)[key] = some
        left.services = {name: of for name, of in self.services.items() if not gone(of.node, of.node_uri)}
        return left

    def parameter(self, name: str) -> Any:
        """The value of a parameter, None where it is not set."""
        value: Any = self.parameters
        for part in _parts(name):
            if not isinstance(value, dict) or part not in value:
                return None
            value = value[part]
        return value


def _user(table: str) -> Callable[[Registry, str, str, str, bool], None]:
    def change(registry: Registry, key: str, node: str, uri: str, there: bool) -> None:
        users = getattr(registry, table).setdefault(key, {})
        if there:
            users[node, uri] = None
        else:
            users.pop((node, uri), None)
        if not users:
            del getattr(registry, table)[key]

    return change


def _service(registry: Registry, service: str, node: str, uri: str, node_uri: str, there: bool) -> None:
    held = registry.services.get(service)
    if there:
        registry.services[service] = Service(node, node_uri, uri)
    elif held is not None and (held.node, held.uri) == (node, uri):
        del registry.services[service]


def _type(registry: Registry, topic: str, kind: str) -> None:
    registry.types[topic] = kind


def _node(registry: Registry, node: str, uri: str) -> None:
    if uri:
        registry.nodes[node] = uri
    else:
        registry.nodes.pop(node, None)


def _set(registry: Registry, name: str, value: Any) -> None:
    """As rosmaster does it: what is on the way to the parameter and no mapping becomes one."""
    parts = _parts(name)
    if not parts:
        if not isinstance(value, dict):
            raise TypeError
        registry.parameters = value
        return
    within = registry.parameters
    for part in parts[:-1]:
        if not isinstance(within.get(part), dict):
            within[part] = {}
        within = within[part]
    within[parts[-1]] = value


def _delete(registry: Registry, name: str) -> None:
    parts = _parts(name)
    within: Any = registry.parameters
    for part in parts[:-1]:
        within = within.get(part) if isinstance(within, dict) else None
    if parts and isinstance(within, dict):
        within.pop(parts[-1], None)


def _parts(name: str) -> List[str]:
    return [part for part in name.split("/") if part]


_APPLY: Dict[str, Callable[..., None]] = {
    "publisher": _user("publishers"),
    "subscriber": _user("subscribers"),
    "listener": _user("listeners"),
    "service": _service,
    "type": _type,
    "node": _node,
    "set": _set,
    "delete": _delete,
}
#: kind -> the types of what follows it
_TYPES: Dict[str, Tuple[type, ...]] = {
    "publisher": (str, str, str, bool),
    "subscriber": (str, str, str, bool),
    "listener": (str, str, str, bool),
    "service": (str, str, str, str, bool),
    "type": (str, str),
    "node": (str, str),
    "set": (str, object),
    "delete": (str,),
}


def told(record: Record) -> Optional[Record]:
    """The record as the feed has it; None where it does not tell of it."""
    kind = record[0]
    if kind in ("publisher", "subscriber"):
        return [kind, record[1], record[2], record[4]]
    if kind == "service":
        return [kind, record[1], record[2], record[3] if record[5] else ""]
    return record if kind in ("type", "node") else None


def told_whole(records: Iterable[Record], parameters: Iterable[Tuple[str, Any]]) -> List[Record]:
    """The whole state as the feed has it, with these parameters and their values."""
    found: Iterable[Optional[Record]] = map(told, records)
    return [record for record in found if record] + [["parameter", *parameter] for parameter in parameters]


def touches(name: str, parameter: str) -> bool:
    """True where a change of the parameter `name` may change `parameter`: it is above, the same, or below."""
    changed, other = _parts(name), _parts(parameter)
    short = min(len(changed), len(other))
    return changed[:short] == other[:short]
