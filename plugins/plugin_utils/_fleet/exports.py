# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Declared data flow: the topics, services, actions and parameters that a robot gives to other robots.

Values of `multimaster_exports` in, entries out. flows.py makes the flows of them; contradictions.py compares them.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from .filters import HOSTS, NAMES, Filters, InvalidPattern
from .values import UnexpectedValue, nearest

# The keys of an entry, and the word for one of its names.
KINDS = {"topics": "topic", "services": "service", "actions": "action", "parameters": "parameter"}

# actionlib: the five topics of an action NAME (section 2 of the report), by who publishes them.
FROM_CLIENT = ("goal", "cancel")
FROM_SERVER = ("status", "feedback", "result")

# Filters of the fleet -> the parameter of the nodes that each becomes. An action is five topics.
FILTERS: Mapping[str, str] = {
    **{{"ignore_type": "ignore_types"}.get(name, name): name for name in (*NAMES, *HOSTS) if name != "do_not_sync"},
    **{f"{rule}_actions": f"{rule}_topics" for rule in ("ignore", "sync")},
}

# The nodes refuse patterns that take too long to match or to read (filters.py). These numbers are fine there.
MOST_STARS = 2  # in one name
MOST_NAMES_WITH = {1: 500, 2: 40}  # stars -> names; an action is three
MOST_TEXT = 32768  # characters of all names

# Parameters are copied by their whole names. The nodes have the same numbers and names (protocol/parameters.py).
MOST_PARAMETERS = 100  # of one robot
_PARAMETER = re.compile(r"(?:/[A-Za-z][A-Za-z0-9_]*)+")
_LONGEST = 255
#: Never copied, and nothing in them: they say what a roscore is, what time it is there, or what the nodes of the exchange are to do.
NEVER_CROSSING = (
    "/run_id",
    "/rosversion",
    "/rosdistro",
    "/roslaunch",
    "/use_sim_time",
    "/do_not_sync",
    "/rosfleet_multimaster",
    "/master_discovery",
    "/master_sync",
)

_NAME = re.compile(r"[/*][A-Za-z0-9_/*]*")


@dataclass(frozen=True)
class Export:
    """One entry: names and patterns, and the robots that get them. No robot in it means every other robot."""

    topics: tuple[str, ...] = ()
    services: tuple[str, ...] = ()
    actions: tuple[str, ...] = ()
    parameters: tuple[str, ...] = ()
    to: tuple[str, ...] = ()

    def __repr__(self) -> str:
        parts = (f"{key}: [{', '.join(items)}]" for key, items in vars(self).items() if items)
        return "{" + ", ".join(parts) + "}"

    def names(self) -> Iterator[tuple[str, str]]:
        """Return (key, name) of each name in the entry."""
        return ((key, name) for key in KINDS for name in getattr(self, key))


def topics_of(actions: Iterable[str], parts: Sequence[str]) -> tuple[str, ...]:
    """Return the topics `parts` of actions. In a filter an action is a regular expression, maybe with `|`."""
    names = (action.strip().rstrip("/") for action in actions)
    return tuple(f"(?:{name})/{part}" if "|" in name else f"{name}/{part}" for name in names for part in parts)


def make_node_filters(filters: Mapping[str, Sequence[str]]) -> dict[str, list[str]]:
    """Return filters of the fleet by the parameters of the nodes, an action as its five topics."""
    parameters: dict[str, list[str]] = {}
    for name, patterns in filters.items():
        texts = topics_of(patterns, FROM_CLIENT + FROM_SERVER) if name.endswith("_actions") else patterns
        parameters.setdefault(FILTERS[name], []).extend(texts)
    return parameters


# Reading


def read_exports(value: Any) -> tuple[Export, ...]:
    """Read the entries of `multimaster_exports`. Raises UnexpectedValue."""
    if not isinstance(value, (list, tuple)) or not all(isinstance(entry, Mapping) for entry in value):
        raise UnexpectedValue("a list of entries such as {topics: [/tibi/pose], to: [dabo]}")
    entries = tuple(map(_read_entry, value))
    contents: set[frozenset[tuple[str, str]]] = set()
    for entry in entries:
        content = frozenset([*entry.names(), *(("to", robot) for robot in entry.to)])
        if content in contents:
            raise UnexpectedValue(f"each entry once, but {entry} is there twice")
        contents.add(content)
    _check_size([item for entry in entries for item in entry.names()])
    _check_parameters({name for entry in entries for name in entry.parameters})
    _check_white_lists(entries)
    return entries


def _check_white_lists(entries: Sequence[Export]) -> None:
    """Raise UnexpectedValue where the nodes do not take the names as patterns."""
    topics = [
        name for entry in entries for name in (*entry.topics, *topics_of(entry.actions, FROM_CLIENT + FROM_SERVER))
    ]
    try:  # the other robots' master_sync has these white lists
        Filters(
            {"sync_topics": topics, "sync_services": [name for entry in entries for name in entry.services]}
        ).check()
    except InvalidPattern as problem:
        raise UnexpectedValue(f"fewer or shorter names, since {problem}") from None


def _check_size(names: Sequence[tuple[str, str]]) -> None:
    if sum(len(name) for _key, name in names) > MOST_TEXT:
        raise UnexpectedValue(f"names of at most {MOST_TEXT} characters together: '*' stands for any text")
    for stars, most in MOST_NAMES_WITH.items():
        count = sum(3 if key == "actions" else 1 for key, name in names if name.count("*") == stars)
        if count > most:
            raise UnexpectedValue(
                f"at most {most} names with {stars} times '*', an action counting three, but there are {count}"
            )


def is_within(name: str, other: str) -> bool:
    """Return True if a parameter is another one, or in the namespace of that name."""
    return f"{name}/".startswith(f"{other}/")


def _check_parameters(names: Collection[str]) -> None:
    if len(names) > MOST_PARAMETERS:
        raise UnexpectedValue(f"at most {MOST_PARAMETERS} parameters, but there are {len(names)}")
    for name in sorted(names):
        inside = next((other for other in sorted(names) if name != other and is_within(name, other)), "")
        if inside:
            raise UnexpectedValue(f"parameters that are not in each other, but {name} is in {inside}")


def _read_entry(entry: Mapping[Any, Any]) -> Export:
    for key in entry:
        if key not in (*KINDS, "to"):
            raise UnexpectedValue(
                f"entries of {', '.join(KINDS)} and to, but there is '{key}'{nearest(str(key), (*KINDS, 'to'))}"
            )
    export = Export(**{str(key): _read_texts(str(key), items) for key, items in entry.items()})
    if not any(export.names()):
        raise UnexpectedValue(f"at least one of {', '.join(KINDS)} in each entry; the list [] exports nothing")
    if "to" in entry and not export.to:
        raise UnexpectedValue("at least one robot in 'to'; without 'to' an entry is for every other robot")
    for key, name in export.names():
        _check_name(key, name)
    return export


def _read_texts(key: str, items: Any) -> tuple[str, ...]:
    if not isinstance(items, (list, tuple)) or not all(isinstance(item, str) and item for item in items):
        raise UnexpectedValue(f"a list of {'robots' if key == 'to' else 'names'} at '{key}', such as " + _SUCH_AS[key])
    return tuple(str(item) for item in items)


_SUCH_AS = {
    "topics": "[/tibi/pose]",
    "services": "[/tibi/reset]",
    "actions": "[/tibi/dock]",
    "parameters": "[/robot_description]",
    "to": "[dabo]",
}


def _check_name(key: str, name: str) -> None:
    if key == "parameters":
        _check_parameter(name)
        return
    if not _NAME.fullmatch(name):
        raise UnexpectedValue(
            f"absolute names of letters, digits, '_', '/' and '*' for any text at '{key}', but there is '{name}'"
        )
    if "//" in name or name.endswith("/"):
        raise UnexpectedValue(
            f"names without an empty part at '{key}', such as /tibi or '/tibi/*', but there is '{name}'"
        )
    if name.count("*") > MOST_STARS:
        raise UnexpectedValue(f"names with at most {MOST_STARS} times '*' at '{key}', but there is '{name}'")


def _check_parameter(name: str) -> None:
    if not _PARAMETER.fullmatch(name) or len(name) > _LONGEST:
        raise UnexpectedValue(
            "whole names of letters, digits, '_' and '/' at 'parameters', since a name has all that is below it, too, but there is "
            f"'{name}'"
        )
    if "/" + name.split("/")[1] in NEVER_CROSSING:
        raise UnexpectedValue(
            f"parameters of the robot's own nodes at 'parameters', but there is '{name}', which belongs to the roscore or to the exchange "
            "itself"
        )
