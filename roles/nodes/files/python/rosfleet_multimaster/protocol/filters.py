# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Filters of the exchange: patterns, the names of all filters, and the rules for one master.

One file for the nodes and for the controller (plugins/plugin_utils/_fleet/filters.py imports it). It needs the standard
library of Python 3.8 only.

In a pattern `*` stands for any text. Everything else is a Python regular expression. A pattern matches a whole name, in
upper or lower case: `/tf` matches only /tf, `/tf*` matches /tf_static too. (So `.*` means "at least one character".)

`Rules` mean the same as upstream's, because they travel: they are the argument of masterInfoFiltered, and the other
robot may run either implementation. `Filters` are the parameters of a node. They avoid upstream's traps.
"""

import re
import reprlib
from dataclasses import dataclass, field, fields, replace
from functools import cached_property, lru_cache
from typing import Any, Callable, Iterable, Iterator, List, Mapping, Optional, Sequence, Tuple

try:
    from re import _compiler  # type: ignore[attr-defined]  # Python 3.11 and later, undocumented
except ImportError:
    import sre_compile as _compiler

MAX_TEXT = 65536  # characters of all patterns of a request
MAX_NAME = 255  # characters of a name; a longer one is not exchanged
UNKNOWN_TYPES = ("", "*", "None")  # written by a master that does not know the type of a topic
CACHED = 4096  # characters of a text that is kept compiled
_NODE = re.compile(r"/?[A-Za-z][A-Za-z0-9_/]{0,255}\Z")


# Patterns


class InvalidPattern(ValueError):
    """The pattern is not usable; the text names it and says why."""


@dataclass(frozen=True)
class Pattern:
    """An alternation of patterns; the empty one matches nothing."""

    text: str = ""

    @classmethod
    def from_items(cls, items: Iterable[str], what: str = "a pattern") -> "Pattern":
        """Make the pattern of a list as people write it. Raises InvalidPattern, naming `what`."""
        texts = []
        for item in items:
            if not isinstance(item, str):
                raise InvalidPattern(f"{what}: {reprlib.repr(item)} is no text")
            if item.strip():
                text = expression(item)
                check_pattern(text, f"{what}: the pattern {item.strip()!r}")
                texts.append(rf"\A(?:{text})\Z" if "|" in text else rf"\A{text}\Z")
                check_pattern(
                    texts[-1], f"{what}: the pattern {item.strip()!r} in its anchors"
                )  # (?i) may only come first
        text = "|".join(texts)
        check_pattern(text, f"{what}: all patterns together")  # a named group may only come once
        return cls(text)

    def __bool__(self) -> bool:
        return bool(self.text)

    def matches(self, name: str) -> bool:
        """True where the whole name matches."""
        return bool(self.text) and len(name) <= MAX_NAME and self._expression.match(name) is not None

    @cached_property
    def _expression(self) -> "re.Pattern[str]":
        return (_compile_once if len(self.text) <= CACHED else _compile)(self.text)


NO_NAME = "(?!)"  # as people write it: a pattern that matches no name
#: The pattern that matches no name: a white list that admits nothing. An empty list would not do: to upstream it is none.
NOTHING = Pattern(rf"\A{NO_NAME}\Z")


def expression(item: str) -> str:
    """The regular expression of one pattern as people write it. It is meant for the whole name, in upper or lower case."""
    return item.strip().replace("*", ".*")


def matches(items: Iterable[str], name: str) -> bool:
    """True where one of the patterns, as people write them, matches the name.

    Each pattern counts by itself, and an unusable one matches nothing. In `usable`, it would spoil the whole list.
    """
    return any(_matches_alone(item, name) for item in items)


@lru_cache(maxsize=65536)
def _matches_alone(item: str, name: str) -> bool:
    try:
        return re.fullmatch(expression(item), name, re.IGNORECASE) is not None
    except (re.error, ValueError, RecursionError, OverflowError):
        return False


def usable(items: Iterable[str]) -> Pattern:
    """The pattern of a list as people write it. An unusable list matches nothing: no node starts with it."""
    return _usable(tuple(items))


@lru_cache(maxsize=4096)
def _usable(items: Tuple[str, ...]) -> Pattern:
    try:
        return Pattern.from_items(items)
    except InvalidPattern:
        return NOTHING


def _compile(text: str) -> "re.Pattern[str]":
    compiled: re.Pattern[str] = _compiler.compile(text, re.IGNORECASE)  # re would keep hundreds, of whatever size
    return compiled


_compile_once = lru_cache(maxsize=64)(_compile)


def check_pattern(text: str, what: str, limit: Callable[[str], Any] = str) -> None:
    """Raise InvalidPattern where the text is too long, or no regular expression. `limit` may refuse it before it is compiled."""
    if len(text) > MAX_TEXT:
        raise InvalidPattern(f"{what} is longer than {MAX_TEXT} characters")
    try:
        limit(text)
        (_can_be_compiled if len(text) <= CACHED else _compile)(text)
    except InvalidPattern:
        raise
    except (re.error, ValueError, RecursionError, OverflowError) as problem:
        raise InvalidPattern(f"{what} is no regular expression: {problem}") from None


@lru_cache(maxsize=512)
def _can_be_compiled(text: str) -> bool:
    """Raise what `_compile` raises. Once for a text: twenty masters with the same filters cost a third of all computing."""
    return _compile(text) is not None


# The rules for one master


@dataclass(frozen=True)
class Rules:
    """The rules of the exchange with one master.

    The fields are the filters: a new one stands at the end. The first ten are the list that masterInfoFiltered takes.
    """

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
        """True where this publisher (or subscriber) is wanted. A sync list cannot take back an ignored node."""
        if max(len(node), len(topic), len(kind)) > MAX_NAME:
            return False
        if self.do_not_sync and any(map(self.do_not_sync.matches, (node, topic, kind))):
            return False
        if (self.ignore_publishers if publisher else self.ignore_subscribers).matches(topic):
            return False
        if self.ignore_type.matches(kind) or self.ignore_nodes.matches(node) or self.ignore_topics.matches(topic):
            return False
        if self.sync_nodes.matches(node) or self.sync_topics.matches(topic):
            return True
        return not self.sync_nodes and not self.sync_topics

    def service(self, node: str, service: str) -> bool:
        """True where this service is wanted. As upstream has it, `sync_topics` says nothing about services."""
        if any(len(name) > MAX_NAME or self.do_not_sync.matches(name) for name in (node, service)):
            return False
        if self.ignore_nodes.matches(node) or self.ignore_services.matches(service):
            return False
        if self.sync_nodes.matches(node) or self.sync_services.matches(service):
            return True
        return not self.sync_nodes and not self.sync_services

    def complete_white_lists(self) -> "Rules":
        """The same rules, where any white list restricts topics and services alike.

        To upstream, a white list of topics alone admits every service. So the empty one of the two lists becomes one
        that admits nothing.
        """
        if not any(getattr(self, name) for name in WHITE_LISTS):
            return self
        return replace(self, sync_topics=self.sync_topics or NOTHING, sync_services=self.sync_services or NOTHING)


# The names of the filters

NAMES = tuple(rule.name for rule in fields(Rules))
HOSTS = ("ignore_hosts", "sync_hosts")
WHITE_LISTS = ("sync_nodes", "sync_topics", "sync_services")
#: Parameters of master_discovery that hide something from every other master -> the filter that each of them is.
HIDDEN = {f"hide_{kind}": f"ignore_{kind}" for kind in ("nodes", "topics", "services", "subscribers")}

#: What fkie_mas, the successor of multimaster_fkie, has beside a roscore. Its /mas_daemon starts programs for whoever calls it.
SUCCESSOR: Mapping[str, Sequence[str]] = {
    "ignore_nodes": ("/mas_discovery", "/mas_sync", "/mas_daemon", "/mas_zeroconf", "/mas_subscriber/*"),
    "ignore_topics": ("/mas_discovery/*", "/mas_sync/*", "/mas_daemon/*", "/mas_zeroconf/*"),
    "ignore_services": ("/mas_discovery/*", "/mas_sync/*", "/mas_daemon/*", "/mas_zeroconf/*"),
    "ignore_type": ("fkie_mas_msgs/*",),
}
#: Never exchanged: what belongs to the roscore and to the exchange itself.
BUILT_IN: Mapping[str, Sequence[str]] = {
    "ignore_nodes": (
        "/rosout",
        "/master_discovery",
        "/master_sync",
        "/master_border",
        "/node_manager",
        "/node_manager_daemon",
        "/zeroconf",
        "/param_sync",
        *SUCCESSOR["ignore_nodes"],
    ),
    "ignore_topics": (
        "/rosout",
        "/rosout_agg",
        "/master_discovery/*",
        "/master_sync/*",
        "/zeroconf/*",
        *SUCCESSOR["ignore_topics"],
    ),
    "ignore_services": (
        "/*get_loggers",
        "/*set_logger_level",
        "/master_discovery/*",
        "/master_sync/*",
        "/node_manager_daemon/*",
        "/zeroconf/*",
        *SUCCESSOR["ignore_services"],
    ),
    "ignore_type": (
        "bond/Status",
        "fkie_multimaster_msgs/SyncTopicInfo",
        "fkie_multimaster_msgs/SyncServiceInfo",
        "fkie_multimaster_msgs/SyncMasterInfo",
        "fkie_multimaster_msgs/MasterState",
        *SUCCESSOR["ignore_type"],
    ),
}


# The parameters of master_sync


@dataclass(frozen=True)
class Filters:
    """The filters of master_sync as they stand in its parameters, for every host."""

    values: Mapping[str, Any] = field(default_factory=dict)
    lenient: bool = False  # unusable patterns match nothing, instead of raising InvalidPattern

    def check(self) -> None:
        """Raise InvalidPattern with a sentence that names the parameter, where a filter is not usable."""
        hosts = {""}
        for what, _name, host, items in self._lists():
            Pattern.from_items(items, what)
            hosts.add(host or "")
        for host in hosts:
            self.wants_host(host)
            self.rules(host)

    def wants_host(self, host: str) -> bool:
        """True where a master of this name is synchronised with. `sync_hosts` is a white list, beside `ignore_hosts` too."""
        if len(host) > MAX_NAME:  # no pattern matches it, so none could ignore it
            return False
        wanted = self._pattern("sync_hosts", host)
        return wanted.matches(host) if wanted else not self._pattern("ignore_hosts", host).matches(host)

    def rules(self, host: str, also_ignore: Sequence[str] = ()) -> Rules:
        """The rules for the master of this name. `also_ignore` are nodes that are never exchanged."""
        # What is no name of a node is somebody's nonsense, and must not become a pattern.
        also = {
            "ignore_nodes": [node for node in also_ignore if _NODE.match(node) and node not in BUILT_IN["ignore_nodes"]]
        }
        return Rules(**{name: self._pattern(name, host, also.get(name, ())) for name in NAMES}).complete_white_lists()

    def patterns(self, name: str, host: str, also: Sequence[str] = ()) -> List[str]:
        """The patterns of one filter for one host: the built-in ones, then `also`, then the own ones."""
        items = [*BUILT_IN.get(name, ()), *also]
        for _what, of, where, values in self._lists():
            if of == name and (where is None or where.lower() == host.lower()):
                items += values
        return items

    def _pattern(self, name: str, host: str, also: Sequence[str] = ()) -> Pattern:
        items = self.patterns(name, host, also)
        return usable(items) if self.lenient else Pattern.from_items(items, name)

    def _lists(self) -> Iterator[Tuple[str, str, Optional[str], List[str]]]:
        """Every list of patterns: its name in the parameters, its filter, its host (None for all), the patterns.

        `<mastername>/<parameter>` is the parameter of one host.
        """
        for name in (*NAMES, *HOSTS):
            for host, items in _parts(name, self.values.get(name)):
                yield name, name, host, items
        for key, section in self.values.items():
            if key not in NAMES + HOSTS and isinstance(section, Mapping):
                for name, value in section.items():
                    for _host, items in _parts(name, value):
                        yield f"{key}/{name}", name, key, items


def _parts(name: str, value: Any) -> List[Tuple[Optional[str], List[str]]]:
    """(host or None for all, patterns) of a parameter: a text, a list, a mapping, or a list with mappings in it."""
    if value in (None, ""):
        return []
    if isinstance(value, Mapping):
        return [(str(host), _list(items, name)) for host, items in value.items()]
    values = _list(value, name)
    parts: List[Tuple[Optional[str], List[str]]] = [(None, [item for item in values if not isinstance(item, Mapping)])]
    return parts + [part for item in values if isinstance(item, Mapping) for part in _parts(name, item)]


def _list(value: Any, name: str) -> List[str]:
    if isinstance(value, str):
        return [value]
    if not isinstance(value, (list, tuple)):
        raise InvalidPattern(f"{name}: {value!r} is no list of patterns")
    return list(value)
