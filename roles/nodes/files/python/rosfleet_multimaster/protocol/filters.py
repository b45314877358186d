# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Filters of the exchange: patterns, the names of all filters, and the rules for one master.

One file for the nodes and for the controller (plugins/plugin_utils/_inventory/filters.py imports it). It needs the standard
library of Python 3.8 only.

In a pattern `*` matches any text. It matches a whole name, in upper or lower case: `/tf` matches only /tf, `/tf*`
matches /tf_static too. A match of such a pattern takes time in proportion to its length and that of the name, so anybody
may write one. Only in the own configuration, everything else is a Python regular expression (so `.*` means "at least one
character"), and one that could take long is refused there.

`Rules` mean the same as upstream's, because they travel: they are the argument of masterInfoFiltered, and the other
robot may run either implementation. `Filters` are the parameters of a node. They avoid upstream's traps.
"""

import re
import reprlib
from dataclasses import dataclass, field, fields, replace
from functools import cached_property, lru_cache
from typing import Any, Callable, FrozenSet, Iterable, Iterator, List, Mapping, Optional, Sequence, Set, Tuple

try:
    from re import _parser  # type: ignore[attr-defined]  # Python 3.11 and later, undocumented
except ImportError:
    import sre_parse as _parser

MAX_TEXT = 65536  # characters of all patterns of a filter, and of a request
MAX_STARRED = 16384  # of those with `*` that others have written: each is tried with each name
MAX_NAME = 255  # characters of a name; a longer one is not exchanged
MAX_COST = (
    40_000_000  # steps of the regular expressions of a filter with one name: about 0.1 s, in which nothing else runs
)
UNKNOWN_TYPES = ("", "*", "None")  # written by a master that does not know the type of a topic
_NODE = re.compile(r"/?[A-Za-z][A-Za-z0-9_/]{0,255}\Z")
_SPECIAL = re.compile(r"[.^$+?{}\[\]\\|()]")  # a name with `*` that has one of these is a regular expression


# Patterns


class InvalidPattern(ValueError):
    """The pattern is not usable; the text names it and says why."""


NO_NAME = "(?!)"  # as people write it: a pattern that matches no name


@dataclass(frozen=True)
class Pattern:
    """Some patterns, as people write them; the empty one matches nothing."""

    items: Tuple[str, ...] = ()

    @classmethod
    def from_items(cls, items: Iterable[str], what: str = "a pattern") -> "Pattern":
        """Make the pattern of a list of the own configuration. Raises InvalidPattern, naming `what`."""
        made, cost = cls(_strip(items, what)), 0
        names: Set[str] = set()
        for item in filter(is_expression, made.items):
            try:
                more, groups = _study(item)
                cost += more
                if groups & names:
                    raise ValueError("a group of it is named as one of another pattern, and upstream joins them")
                names |= groups
                if cost <= MAX_COST:
                    _compile(item)
            except (re.error, ValueError, RecursionError, OverflowError) as problem:
                raise InvalidPattern(
                    f"{what}: the pattern {item[:200]!r} is no regular expression: {problem}"
                ) from None
            if cost > MAX_COST:
                raise InvalidPattern(
                    f"{what}: the pattern {item[:200]!r} would be too costly: it has too many repetitions, or one in another;"
                    " names with '*' and nothing else may have any number"
                )
        return made

    @classmethod
    def from_foreign_items(cls, items: Iterable[str], what: str) -> "Pattern":
        """Make the pattern of a list that anybody may have written: only of names with `*`. Raises InvalidPattern."""
        made = cls(_strip(items, what))
        for item in filter(is_expression, made.items):
            raise InvalidPattern(
                f"{what} has {reprlib.repr(item)}, but a name is expected, in which '*' matches any text: a regular"
                " expression is taken only of the node's own file"
            )
        if made.starred > MAX_STARRED:
            raise InvalidPattern(f"{what} has more than {MAX_STARRED} characters in names with '*'")
        return made

    def __bool__(self) -> bool:
        return bool(self.items)

    @property
    def starred(self) -> int:
        """The characters of the names with `*`."""
        return sum(len(item) for item in self.items if "*" in item)

    def matches(self, name: str) -> bool:
        """True if the whole name matches."""
        if not self.items or len(name) > MAX_NAME:
            return False
        name, (whole, starred, expressions) = name.lower(), self._parts
        return (
            name in whole
            or any(_is_match(name, parts) for parts in starred)
            or any(expression.fullmatch(name) for expression in expressions)
        )

    @cached_property
    def _parts(self) -> Tuple[Any, Any, Any]:
        """Sort the patterns: names, names with `*` in their parts, and regular expressions."""
        plain = [item.lower() for item in self.items if item != NO_NAME and not is_expression(item)]
        expressions = [_compile(item) for item in self.items if is_expression(item)]
        return {*plain}, [item.split("*") for item in plain if "*" in item], expressions


#: The pattern that matches no name: a white list that admits nothing. An empty list would not do: to upstream it means that no list is set.
NOTHING = Pattern((NO_NAME,))


def _strip(items: Iterable[str], what: str) -> Tuple[str, ...]:
    texts, size = [], 0
    for item in items:
        if not isinstance(item, str):
            raise InvalidPattern(f"{what}: {reprlib.repr(item)} is no text")
        texts.append(item.strip())
        size += len(item) + item.count("*") + 5  # with its anchors, as it travels
        if size > MAX_TEXT:
            raise InvalidPattern(f"{what} is longer than {MAX_TEXT} characters")
    return tuple(filter(None, texts))


def is_expression(item: str) -> bool:
    """True if a pattern is a regular expression, and no name with `*`."""
    return bool(_SPECIAL.search(item)) and item != NO_NAME


def _is_match(name: str, parts: List[str]) -> bool:
    """True if a name is made of these parts, with any text between two of them. The first place of each part will do."""
    head, tail = parts[0], parts[-1]
    at, end = len(head), len(name) - len(tail)
    if at > end or not name.startswith(head) or not name.endswith(tail):
        return False
    for part in parts[1:-1]:
        found = name.find(part, at, end)
        if found < 0:
            return False
        at = found + len(part)
    return True


@lru_cache(maxsize=512)
def _compile(item: str) -> "re.Pattern[str]":
    return re.compile(item.replace("*", ".*"), re.IGNORECASE)


@lru_cache(maxsize=512)
def _study(item: str) -> Tuple[int, FrozenSet[str]]:
    """The steps of an expression, and the names of its groups."""
    tree = _parser.parse(rf"\A(?:{item.replace('*', '.*')})\Z", re.IGNORECASE)  # (?i) may only come first
    return _cost(tree)[1], frozenset(tree.state.groupdict)


def _cost(tree: Any) -> Tuple[int, int]:
    """(ways, steps) of an expression: in how many ways it can match a name, and the steps of trying all of them."""
    ways, steps = 1, 1
    for operation, argument in tree:
        its_ways, its_steps = _cost_of_part(str(operation), argument)
        steps = min(steps + ways * its_steps, MAX_COST + 1)
        ways = min(ways * its_ways, MAX_COST + 1)
    return ways, steps


def _cost_of_part(operation: str, argument: Any) -> Tuple[int, int]:
    if "REPEAT" in operation:
        low, high, inner = argument
        ways, steps = _cost(inner)
        times = max(low, min(high, MAX_NAME))
        if ways > 1:
            return ways ** min(times + 1, 64), MAX_COST + 1 if times > 64 else steps * times * ways**times
        return max(1, times - low + 1), steps * times
    if operation == "BRANCH":
        parts = [_cost(branch) for branch in argument[1]]
        return sum(ways for ways, _steps in parts), sum(steps for _ways, steps in parts)
    if operation in ("SUBPATTERN", "ATOMIC_GROUP", "ASSERT", "ASSERT_NOT"):
        return _cost(argument if operation == "ATOMIC_GROUP" else argument[-1])
    if operation == "IN":  # names are ASCII, and a wide range takes long to compile
        is_wide = any(str(kind) == "RANGE" and value[1] > 0xFF for kind, value in argument)
        return 1, MAX_COST + 1 if is_wide else len(argument)
    if operation.startswith("GROUPREF"):
        raise ValueError("it refers to a group, and upstream joins all patterns")
    return 1, 1


def matches(items: Iterable[str], name: str) -> bool:
    """True if one of the patterns, as people write them, matches the name.

    Each pattern counts by itself, and an unusable one matches nothing. In `usable`, it would spoil the whole list.
    """
    return any(_usable((item,)).matches(name) for item in items)


def usable(items: Iterable[str]) -> Pattern:
    """The pattern of a list as people write it. An unusable list matches nothing: no node starts with it."""
    return _usable(tuple(items))


@lru_cache(maxsize=4096)
def _usable(items: Tuple[str, ...]) -> Pattern:
    try:
        return Pattern.from_items(items)
    except InvalidPattern:
        return NOTHING


def secret_names(value: Any) -> Pattern:
    """The names in /do_not_sync of a roscore, which every program may write, and which is remembered. Raises InvalidPattern."""
    return Pattern.from_foreign_items(value if isinstance(value, list) else [value] if value else [], "/do_not_sync")


# The rules for one master


@dataclass(frozen=True)
class Rules:
    """The rules of the exchange with one master.

    The fields are the filters: a new one is at the end. The first ten are the list that masterInfoFiltered takes.
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
        """True if this publisher (or subscriber) is wanted. A sync list cannot take back an ignored node."""
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
        """True if this service is wanted. As upstream has it, `sync_topics` says nothing about services."""
        if any(len(name) > MAX_NAME or self.do_not_sync.matches(name) for name in (node, service)):
            return False
        if self.ignore_nodes.matches(node) or self.ignore_services.matches(service):
            return False
        if self.sync_nodes.matches(node) or self.sync_services.matches(service):
            return True
        return not self.sync_nodes and not self.sync_services

    def complete_white_lists(self) -> "Rules":
        """The same rules, if any white list restricts topics and services alike.

        To upstream, a white list of only topics admits every service. So the empty one of the two lists becomes one
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

#: The nodes and services of fkie_mas, the successor of multimaster_fkie. Its /mas_daemon starts programs for any caller.
SUCCESSOR: Mapping[str, Sequence[str]] = {
    "ignore_nodes": ("/mas_discovery", "/mas_sync", "/mas_daemon", "/mas_zeroconf", "/mas_subscriber/*"),
    "ignore_topics": ("/mas_discovery/*", "/mas_sync/*", "/mas_daemon/*", "/mas_zeroconf/*"),
    "ignore_services": ("/mas_discovery/*", "/mas_sync/*", "/mas_daemon/*", "/mas_zeroconf/*"),
    "ignore_type": ("fkie_mas_msgs/*",),
}
#: Never exchanged: names of the roscore and of the exchange itself.
BUILT_IN: Mapping[str, Sequence[str]] = {
    "ignore_nodes": (
        "/rosout",
        "/master_discovery",
        "/master_sync",
        "/master_relay",
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
    """The filters of master_sync as they are in its parameters, for every host."""

    values: Mapping[str, Any] = field(default_factory=dict)
    lenient: bool = False  # unusable patterns match nothing, instead of raising InvalidPattern

    def check(self, make: Callable[[Iterable[str], str], Pattern] = Pattern.from_items) -> None:
        """Raise InvalidPattern with a sentence that names the parameter, if a filter is not usable.

        `make`: Pattern.from_foreign_items, if anybody may have set them.
        """
        hosts = {""}
        for what, _name, host, items in self._lists():
            make(items, what)
            hosts.add(host or "")
        for host in hosts:
            self.wants_host(host)
            self.rules(host)

    def wants_host(self, host: str) -> bool:
        """True if a master of this name is synchronised with. `sync_hosts` is a white list, with `ignore_hosts`, too."""
        if len(host) > MAX_NAME:  # no pattern matches it, so no pattern could ignore it
            return False
        wanted = self._pattern("sync_hosts", host)
        return wanted.matches(host) if wanted else not self._pattern("ignore_hosts", host).matches(host)

    def rules(self, host: str, also_ignore: Sequence[str] = ()) -> Rules:
        """The rules for the master of this name. `also_ignore` are nodes that are never exchanged."""
        # A text that is no name of a node makes no sense, and must not become a pattern.
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
