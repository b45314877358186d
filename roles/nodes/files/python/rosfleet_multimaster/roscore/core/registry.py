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

from typing import Any, Callable, Dict, Iterable, Iterator, List, NamedTuple, Tuple

Record = List[Any]
NodeKey = Tuple[str, str]  # a node: its name and its URI


class Service(NamedTuple):
    """The provider of a service."""

    node: str
    node_uri: str
    uri: str


#: kind of a record about a node that uses something -> the table of these
_USERS = {"publisher": "publishers", "subscriber": "subscribers", "listener": "listeners"}


class Registry:
    """All that a roscore knows, as plain data."""

    def __init__(self) -> None:
        self.publishers: Dict[str, Dict[NodeKey, None]] = {}  # each a set that keeps the order
        self.subscribers: Dict[str, Dict[NodeKey, None]] = {}
        self.listeners: Dict[str, Dict[NodeKey, None]] = {}
        self.services: Dict[str, Service] = {}
        self.types: Dict[str, str] = {}
        self.nodes: Dict[str, str] = {}
        self.parameters: Dict[str, Any] = {}

    def apply(self, record: Record) -> None:
        """Carry out a record. Raises ValueError where it is malformed."""
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

    def current(self, record: Record) -> Record:
        """What is true now of the thing in a record: its presence, or the type or the URI that it has."""
        kind, key, *rest = record
        if kind in _USERS:
            return [*record[:4], tuple(rest[:2]) in getattr(self, _USERS[kind]).get(key, {})]
        if kind == "service":
            service = self.services.get(key)
            there = service is not None and (service.node, service.uri) == tuple(rest[:2])
            return [kind, key, *rest[:2], service.node_uri if service and there else rest[2], there]
        return [kind, key, (self.types if kind == "type" else self.nodes).get(key, "")]

    def records(self) -> Iterator[Record]:
        """The records that make this registry out of an empty one."""
        yield ["set", "/", self.parameters]
        for topic, kind in self.types.items():
            yield ["type", topic, kind]
        for node, uri in self.nodes.items():
            yield ["node", node, uri]
        for name, table in _USERS.items():
            for key, users in getattr(self, table).items():
                for node, uri in users:
                    yield [name, key, node, uri, True]
        for name, service in self.services.items():
            yield ["service", name, service.node, service.uri, service.node_uri, True]

    def exclude(self, is_gone: Callable[[str, str], bool]) -> "Registry":
        """A copy without the nodes for which `is_gone(name, URI)` is true. Topic types and parameters stay."""
        rest = Registry()
        rest.types, rest.parameters = self.types, self.parameters
        rest.nodes = {node: uri for node, uri in self.nodes.items() if not is_gone(node, uri)}
        for table in _USERS.values():
            for key, users in getattr(self, table).items():
                some = {node: None for node in users if not is_gone(*node)}
                if some:
                    getattr(rest, table)[key] = some
        rest.services = {key: it for key, it in self.services.items() if not is_gone(it.node, it.node_uri)}
        return rest

    def parameter(self, name: str) -> Any:
        """The value of a parameter, None where it is not set."""
        value: Any = self.parameters
        for part in split_name(name):
            if not isinstance(value, dict) or part not in value:
                return None
            value = value[part]
        return value


def _make_user_change(table: str) -> Callable[[Registry, str, str, str, bool], None]:
    def change(registry: Registry, key: str, node: str, uri: str, there: bool) -> None:
        users = getattr(registry, table).setdefault(key, {})
        if there:
            users[node, uri] = None
        else:
            users.pop((node, uri), None)
        if not users:
            del getattr(registry, table)[key]

    return change


def _set_service(registry: Registry, service: str, node: str, uri: str, node_uri: str, there: bool) -> None:
    present = registry.services.get(service)
    if there:
        registry.services[service] = Service(node, node_uri, uri)
    elif present is not None and (present.node, present.uri) == (node, uri):
        del registry.services[service]


def _make_value_change(table: str) -> Callable[[Registry, str, str], None]:
    def change(registry: Registry, name: str, value: str) -> None:
        if value:
            getattr(registry, table)[name] = value
        else:
            getattr(registry, table).pop(name, None)

    return change


def _set_parameter(registry: Registry, name: str, value: Any) -> None:
    """As rosmaster does it: each part of the name above the parameter becomes a mapping."""
    parts = split_name(name)
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


def _delete_parameter(registry: Registry, name: str) -> None:
    parts = split_name(name)
    within: Any = registry.parameters
    for part in parts[:-1]:
        within = within.get(part) if isinstance(within, dict) else None
    if parts and isinstance(within, dict):
        within.pop(parts[-1], None)


def split_name(name: str) -> List[str]:
    """The parts of the name of a parameter."""
    return [part for part in name.split("/") if part]


_APPLY: Dict[str, Callable[..., None]] = {
    **{kind: _make_user_change(table) for kind, table in _USERS.items()},
    "service": _set_service,
    "type": _make_value_change("types"),
    "node": _make_value_change("nodes"),
    "set": _set_parameter,
    "delete": _delete_parameter,
}
#: kind -> the types of what follows it
_TYPES: Dict[str, Tuple[type, ...]] = {
    **dict.fromkeys(_USERS, (str, str, str, bool)),
    "service": (str, str, str, str, bool),
    "type": (str, str),
    "node": (str, str),
    "set": (str, object),
    "delete": (str,),
}


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
