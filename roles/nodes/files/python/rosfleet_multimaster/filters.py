# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""What is exchanged: patterns of nodes, topics, services, types and hosts, with upstream's semantics.

In a pattern `*` stands for any characters and everything else is a Python regular expression, matched as a whole and
without regard to case: `/tf` is only /tf, `/tf*` also /tf_static. (`.*` therefore means "at least one character".)
"""

import re
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, Iterable, List, Mapping, Optional, Sequence, Set, Tuple

try:
    from re import _parser as _sre  # type: ignore[attr-defined]  # Python 3.11 and later
except ImportError:
    import sre_parse as _sre  # type: ignore[no-redef]

MAX_TEXT = 65536  # characters of all patterns of a request
MAX_OPEN = 6  # choices (repetitions, groups of alternatives) in one alternative: the cost grows exponentially with them
_NODE = re.compile(r"/?[A-Za-z][A-Za-z0-9_/]{0,255}\Z")


class InvalidPattern(ValueError):
    """The pattern cannot be used; the text names it and says why."""


@dataclass(frozen=True)
class Pattern:
    """An alternation of patterns; the empty one matches nothing."""

    text: str = ""

    @classmethod
    def of(cls, items: Iterable[str], what: str = "a pattern") -> "Pattern":
        """The pattern of a list as people write it. Raises InvalidPattern, naming `what`."""
        texts = []
        for item in items:
            if not isinstance(item, str):
                raise InvalidPattern(f"{what}: {item!r} is no text")
            if item.strip():
                text = item.strip().replace("*", ".*")
                _check(text, f"{what}: the pattern {item.strip()!r}")
                texts.append(rf"\A(?:{text})\Z" if "|" in text else rf"\A{text}\Z")
                _check(texts[-1], f"{what}: the pattern {item.strip()!r} in its anchors")  # (?i) may only come first
        text = "|".join(texts)
        _check(text, f"{what}: all patterns together")  # a named group may only come once
        return cls(text)

    @classmethod
    def from_wire(cls, text: Any) -> "Pattern":
        """The pattern that another computer sent. Raises InvalidPattern also where it would be too costly."""
        if not isinstance(text, str):
            raise InvalidPattern(f"{text!r} is no text")
        _check(text, "the pattern", costly=False)
        return cls(text)

    def __bool__(self) -> bool:
        return bool(self.text)

    def matches(self, name: str) -> bool:
        """Whether the whole name is matched."""
        return bool(self.text) and _matches(self.text, name)


@lru_cache(maxsize=256)
def _compiled(text: str) -> "re.Pattern[str]":
    return re.compile(text, re.IGNORECASE)


@lru_cache(maxsize=65536)
def _matches(text: str, name: str) -> bool:
    return _compiled(text).match(name) is not None


def _check(text: str, what: str, costly: bool = True) -> None:
    if len(text) > MAX_TEXT:
        raise InvalidPattern(f"{what} is longer than {MAX_TEXT} characters")
    try:
        tree = _sre.parse(text, re.IGNORECASE)
        re.compile(text, re.IGNORECASE)
    except (re.error, ValueError, RecursionError, OverflowError) as problem:
        raise InvalidPattern(f"{what} is no regular expression: {problem}") from None
    if not costly and _openness(tree, alternatives=True) > MAX_OPEN:
        raise InvalidPattern(f"{what} would be too costly: more than {MAX_OPEN} repetitions, or one in another")


def _openness(tree: Any, alternatives: bool = False) -> int:
    """How many choices follow each other in a pattern; one that is repeated counts as often, or as too many.

    `alternatives`: the first alternation is that of whole patterns, which are tried one after the other.
    """
    count = 0
    for operation, argument in tree:
        name = str(operation)
        if "REPEAT" in name:
            low, high, inner = argument
            count += _openness(inner) * min(high, MAX_OPEN + 1) + (1 if low != high else 0)
        elif name == "BRANCH":
            count += max(_openness(branch) for branch in argument[1])
            count += 0 if alternatives else (len(argument[1]).bit_length() + 3) // 4
            alternatives = False
        elif name == "SUBPATTERN":
            count += _openness(argument[-1])
        elif name == "ATOMIC_GROUP":
            count += _openness(argument)
        elif name in ("ASSERT", "ASSERT_NOT"):
            count += _openness(argument[1])
        elif name in ("GROUPREF", "GROUPREF_EXISTS", "GROUPREF_IGNORE"):
            count += MAX_OPEN + 1
    return count


# The rules of a master

# The order is that of the list which masterInfoFiltered takes, after its first element (sync_remote_nodes).
NAMES = (
    "ignore_nodes",
    "sync_nodes",
    "ignore_topics",
    "sync_topics",
    "ignore_services",
    "sync_services",
    "ignore_type",
    "ignore_publishers",
    "ignore_subscribers",
    "do_not_sync",
)
HOSTS = ("ignore_hosts", "sync_hosts")

# Never exchanged: what belongs to the roscore and to the exchange itself.
BUILT_IN: Mapping[str, Sequence[str]] = {
    "ignore_nodes": (
        "/rosout",
        "/master_discovery",
        "/master_sync",
        "/node_manager",
        "/node_manager_daemon",
        "/zeroconf",
        "/param_sync",
    ),
    "ignore_topics": ("/rosout", "/rosout_agg", "/master_discovery/*", "/master_sync/*", "/zeroconf/*"),
    "ignore_services": (
        "/*get_loggers",
        "/*set_logger_level",
        "/master_discovery/*",
        "/master_sync/*",
        "/node_manager_daemon/*",
        "/zeroconf/*",
    ),
    "ignore_type": (
        "bond/Status",
        "fkie_multimaster_msgs/SyncTopicInfo",
        "fkie_multimaster_msgs/SyncServiceInfo",
        "fkie_multimaster_msgs/SyncMasterInfo",
        "fkie_multimaster_msgs/MasterState",
    ),
}


@dataclass(frozen=True)
class Rules:
    """What is exchanged with one master."""

    ignore_nodes: Pattern = Pattern()
    sync_nodes: Pattern = Pattern()
    ignore_topics: Pattern = Pattern()
    sync_topics: Pattern = Pattern()
    ignore_services: Pattern = Pattern()
    sync_services: Pattern = Pattern()
    ignore_type: Pattern = Pattern()
    ignore_publishers: Pattern = Pattern()
    ignore_subscribers: Pattern = Pattern()
    do_not_sync: Pattern = Pattern()

    def topic(self, node: str, topic: str, kind: str, publisher: bool) -> bool:
        """Whether this publisher (or subscriber) is wanted. An ignored node cannot be re-admitted by a sync list."""
        if any(self.do_not_sync.matches(name) for name in (node, topic, kind)):
            return False
        if (self.ignore_publishers if publisher else self.ignore_subscribers).matches(topic):
            return False
        if self.ignore_type.matches(kind) or self.ignore_nodes.matches(node) or self.ignore_topics.matches(topic):
            return False
        if self.sync_nodes.matches(node) or self.sync_topics.matches(topic):
            return True
        return not self.sync_nodes and not self.sync_topics

    def service(self, node: str, service: str) -> bool:
        """Whether this service is wanted. A white list of topics does not restrict services."""
        if self.do_not_sync.matches(node) or self.do_not_sync.matches(service):
            return False
        if self.ignore_nodes.matches(node) or self.ignore_services.matches(service):
            return False
        if self.sync_nodes.matches(node) or self.sync_services.matches(service):
            return True
        return not self.sync_nodes and not self.sync_services

    def to_wire(self, sync_remote_nodes: bool) -> List[Any]:
        """The list that masterInfoFiltered takes."""
        return [sync_remote_nodes] + [getattr(self, name).text for name in NAMES]

    @classmethod
    def from_wire(cls, value: Any) -> "Rules":
        """The rules that another computer sent, 8 to 11 elements. Raises InvalidPattern."""
        if not isinstance(value, (list, tuple)) or not 8 <= len(value) <= 11:
            raise InvalidPattern("the filter is no array of 8 to 11 elements")
        if sum(len(text) for text in value[1:] if isinstance(text, str)) > MAX_TEXT:
            raise InvalidPattern(f"the patterns are longer than {MAX_TEXT} characters")
        return cls(**{name: Pattern.from_wire(text) for name, text in zip(NAMES, value[1:])})


@dataclass(frozen=True)
class Filters:
    """The filters of master_sync as they stand in its parameters, valid for every host."""

    values: Mapping[str, Any] = field(default_factory=dict)

    def check(self) -> None:
        """Raises InvalidPattern with a sentence that names the parameter."""
        for name in (*NAMES, *HOSTS):
            for _host, items in _parts(name, self.values.get(name)):
                Pattern.of(items, name)
        for host, section in self._sections():
            for name, value in section.items():
                for _host, items in _parts(name, value):
                    Pattern.of(items, f"{host}/{name}")
        for host in self._hosts():
            self.wants_host(host)
            self.rules(host)

    def wants_host(self, host: str) -> bool:
        """Whether a master of this name is synchronised with; ignored hosts are re-admitted by `sync_hosts`.

        As upstream does it: beside `ignore_hosts`, `sync_hosts` restricts nothing. The white list that always works is
        `ignore_hosts: ['*']` with `sync_hosts`.
        """
        ignored, wanted = self._pattern("ignore_hosts", host), self._pattern("sync_hosts", host)
        if not ignored:
            return not wanted or wanted.matches(host)
        return not ignored.matches(host) or wanted.matches(host)

    def rules(self, host: str, also_ignore: Sequence[str] = ()) -> Rules:
        """The rules for the master of this name; `also_ignore` are nodes that are never exchanged."""
        patterns = {name: self._pattern(name, host, BUILT_IN.get(name, ())) for name in NAMES}
        # What is no name of a node is somebody's nonsense, and must not become a pattern.
        nodes = [node for node in also_ignore if _NODE.match(node) and node not in BUILT_IN["ignore_nodes"]]
        patterns["ignore_nodes"] = self._pattern("ignore_nodes", host, (*BUILT_IN["ignore_nodes"], *nodes))
        return Rules(**patterns)

    def _pattern(self, name: str, host: str, always: Sequence[str] = ()) -> Pattern:
        items = list(always)
        for of, values in _parts(name, self.values.get(name)):
            if of is None or of.lower() == host.lower():
                items += values
        for of, section in self._sections():
            if of.lower() == host.lower():
                for _of, values in _parts(name, section.get(name)):
                    items += values
        return Pattern.of(items, name)

    def _hosts(self) -> Set[str]:
        """The hosts with filters of their own, and "" for all others."""
        values = [part for name in (*NAMES, *HOSTS) for part in _parts(name, self.values.get(name))]
        return {"", *(host for host, _items in values if host), *(host for host, _section in self._sections())}

    def _sections(self) -> List[Tuple[str, Mapping[str, Any]]]:
        """`<mastername>/<parameter>`: the parameters of one host."""
        return [
            (key, value)
            for key, value in self.values.items()
            if key not in NAMES + HOSTS and isinstance(value, Mapping)
        ]


def _parts(name: str, value: Any) -> List[Tuple[Optional[str], List[str]]]:
    """(host or None for all, patterns) of a parameter: a text, a list, a mapping, or a list with mappings in it."""
    if value in (None, ""):
        return []
    if isinstance(value, str):
        return [(None, [value])]
    if isinstance(value, Mapping):
        return [(str(host), _list(items, name)) for host, items in value.items()]
    if not isinstance(value, (list, tuple)):
        raise InvalidPattern(f"{name}: {value!r} is no list of patterns")
    parts: List[Tuple[Optional[str], List[str]]] = [(None, [item for item in value if not isinstance(item, Mapping)])]
    for item in value:
        if isinstance(item, Mapping):
            parts += [(str(host), _list(items, name)) for host, items in item.items()]
    return parts


def _list(value: Any, name: str) -> List[str]:
    if isinstance(value, str):
        return [value]
    if not isinstance(value, (list, tuple)):
        raise InvalidPattern(f"{name}: {value!r} is no list of patterns")
    return list(value)
