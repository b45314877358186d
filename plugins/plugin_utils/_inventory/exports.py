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

from .._base.sentences import UnexpectedValue, nearest
from .filters import CROSSING, HOSTS, NAMES, NEVER_CROSSING, Filters, InvalidPattern

# The keys of an entry, and the word for one of its names.
KINDS = {"topics": "topic", "services": "service", "actions": "action", "parameters": "parameter", "back": "topic"}

# actionlib: the five topics of an action NAME (section 2 of the report), by who publishes them.
FROM_CLIENT = ("goal", "cancel")
FROM_SERVER = ("status", "feedback", "result")

# Filters of the fleet -> the parameter of the nodes that each becomes. An action is five topics.
FILTERS: Mapping[str, str] = {
    **{{"ignore_type": "ignore_types"}.get(name, name): name for name in (*NAMES, *HOSTS) if name != "do_not_sync"},
    **{f"{rule}_actions": f"{rule}_topics" for rule in ("ignore", "sync")},
}

# Each name with a star is tried with each name of a robot, and more would not travel (wire_filters.py).
MOST_STARS = 2  # in one name
MOST_NAMES_WITH = {1: 500, 2: 40}  # stars -> names; an action is three
MOST_TEXT = 32768  # characters of all names

# Of parameters, which are copied by their whole names, and of namespaces.
_WHOLE_NAME = re.compile(r"(?:/[A-Za-z][A-Za-z0-9_]*)+")
_LONGEST = 255
_NAME = re.compile(r"[/*][A-Za-z0-9_/*]*")

# The keys that make an entry one of the relay, which renames topics and keeps their rate.
OF_RELAY = ("as", "rate", "newest", "frames", "whole")
_PREFIX = re.compile(r"(?:[A-Za-z0-9]+[/_])+")
DIAGNOSTICS = "/diagnostics"
FASTEST = 1000.0  # messages a second
_TYPE = re.compile(r"[A-Za-z][A-Za-z0-9_]*/(?:[A-Za-z][A-Za-z0-9_]*|\*)")  # of messages, or all of a package
MOST_TYPES = 100


@dataclass(frozen=True)
class Export:
    """One entry: names and patterns, and the robots that get them. No robot in it means every other robot.

    With a namespace, a rate, `newest` or `frames`, its topics cross by the relays of the two robots.
    """

    topics: tuple[str, ...] = ()
    services: tuple[str, ...] = ()
    actions: tuple[str, ...] = ()
    parameters: tuple[str, ...] = ()
    back: tuple[str, ...] = ()  # topics that come from the receivers
    to: tuple[str, ...] = ()
    namespace: str = ""  # below which the receivers have the names, or the receivers' name of the only one: 'as'
    base: str = ""  # the beginning of the names that it replaces
    rate: float = 0.0  # messages a second of each topic at most; 0: all
    newest: bool = False  # if the link is too slow, only the newest message waits
    frames: str = ""  # in front of the robot's frames, in messages that cross
    whole: tuple[str, ...] = ()  # types of which each message replaces the one before: they have the rate

    @property
    def is_relayed(self) -> bool:
        """True if its topics, services and actions cross by the relays."""
        is_changed = self.namespace or self.rate or self.newest or self.frames
        return bool(is_changed and (self.topics or self.services or self.actions or self.back))

    @property
    def given_topics(self) -> tuple[str, ...]:
        """The topics that go to the receivers, also those of its actions."""
        return self.topics + topics_of(self.actions, FROM_SERVER)

    @property
    def topic_names(self) -> tuple[str, ...]:
        """Its topics of both ways, also those of its actions."""
        return self.given_topics + self.back + topics_of(self.actions, FROM_CLIENT)

    def __repr__(self) -> str:
        words = {"namespace": "as"}
        parts = (
            f"{words.get(key, key)}: {'[' + ', '.join(value) + ']' if isinstance(value, tuple) else value}"
            for key, value in vars(self).items()
            if value and key != "base"
        )
        return "{" + ", ".join(parts) + "}"

    def rename(self, name: str) -> str:
        """Return the receivers' name of a name or pattern of this entry: with the namespace in place of the base."""
        return self.namespace + name[len(self.base) :]

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
    entries = tuple(export for entry in value for export in _read_entries(entry))
    contents: set[frozenset[tuple[str, str]]] = set()
    for entry in entries:
        content = frozenset([*entry.names(), *(("to", robot) for robot in entry.to), ("as", entry.namespace)])
        if content in contents:
            raise UnexpectedValue(f"each entry once, but {entry} is there twice")
        contents.add(content)
        _check_way_back(entry)
    _check_size([item for entry in entries for item in entry.names()])
    _check_parameters({(entry.rename(name), name) for entry in entries for name in entry.parameters})
    _check_white_lists(entries)
    return entries


def _check_white_lists(entries: Sequence[Export]) -> None:
    """Raise UnexpectedValue if the nodes do not take the names as patterns."""
    topics = [name for entry in entries for name in entry.topic_names]
    services = [name for entry in entries for name in entry.services]
    try:  # the other robots' master_sync has these white lists
        Filters({"sync_topics": topics, "sync_services": services}).check()
    except InvalidPattern as problem:
        raise UnexpectedValue(f"fewer or shorter names, since {problem}") from None


def _check_size(names: Sequence[tuple[str, str]]) -> None:
    if sum(len(name) for _key, name in names) > MOST_TEXT:
        raise UnexpectedValue(f"names of at most {MOST_TEXT} characters together: '*' matches any text")
    for stars, most in MOST_NAMES_WITH.items():
        count = sum(3 if key == "actions" else 1 for key, name in names if name.count("*") == stars)
        if count > most:
            raise UnexpectedValue(
                f"at most {most} names with {stars} times '*', an action counting three, but there are {count}"
            )


def is_within(name: str, other: str) -> bool:
    """Return True if a parameter is another one, or in the namespace of that name."""
    return f"{name}/".startswith(f"{other}/")


def _check_parameters(names: Collection[tuple[str, str]]) -> None:
    """Check the receivers' names of parameters, each with that of the robot. Raises UnexpectedValue."""
    if len(names) > CROSSING:
        raise UnexpectedValue(f"at most {CROSSING} parameters, but there are {len(names)}")
    for one in sorted(names):
        inside = next((other for other in sorted(names) if one != other and is_within(one[0], other[0])), None)
        if inside:
            raise UnexpectedValue(
                f"parameters that are not in each other at the receivers, but {one[0]} is in {inside[0]}"
            )


def _read_entries(entry: Mapping[Any, Any]) -> Iterator[Export]:
    """Read an entry: one export, or one for each name, if 'as' has another name for each."""
    renamed = entry.get("as")
    if not isinstance(renamed, Mapping):
        yield _read_entry(entry)
        return
    whole = _read_entry({key: value for key, value in entry.items() if key != "as"})
    _check_renamed(whole, [name for _key, name in whole.names()], list(renamed))
    for key, name in whole.names():
        yield _read_entry({**entry, **dict.fromkeys(KINDS, []), key: [name], "as": renamed[name]}, base=name)


def _check_renamed(whole: Export, named: Sequence[str], renamed: Sequence[Any]) -> None:
    """Raise UnexpectedValue unless 'as' has another name for each name of an entry, and for these names alone."""
    wanted = "at 'as' a namespace such as /front, or another name for each topic, service and action of the entry, such as {/scan: /front/scan}"
    unknown = next((name for name in renamed if name not in named), None)
    if unknown is not None:
        raise UnexpectedValue(f"{wanted}, but the entry has no '{unknown}'{nearest(str(unknown), named)}")
    missing = next((name for name in named if name not in renamed), None)
    if missing is not None:
        raise UnexpectedValue(f"{wanted}, but there is none for '{missing}'")
    starred = next((name for name in named if "*" in name), "parameters" if whole.parameters else None)
    if starred is not None:
        raise UnexpectedValue(f"{wanted}, none of them with '*', and no parameters, but there is '{starred}'")


def _read_entry(entry: Mapping[Any, Any], base: str = "") -> Export:
    known = (*KINDS, "to", *OF_RELAY)
    for key in entry:
        if key not in known:
            raise UnexpectedValue(
                f"entries of {', '.join(KINDS)}, to, and {', '.join(OF_RELAY)}, but there is '{key}'{nearest(str(key), known)}"
            )
    names: dict[str, Any] = {
        str(key): _read_texts(str(key), items) for key, items in entry.items() if key not in OF_RELAY
    }
    export = Export(**names, **_read_relay(entry), base=base)
    if export.rate or export.newest or export.frames:
        _check_kinds(export)
    if not any(export.names()):
        raise UnexpectedValue(f"at least one of {', '.join(KINDS)} in each entry; the list [] exports nothing")
    if "to" in entry and not export.to:
        raise UnexpectedValue("at least one robot in 'to'; without 'to' an entry is for every other robot")
    for key, name in export.names():
        _check_name(key, name)
    for name in export.parameters:
        _check_parameter(export.rename(name))
    return export


def _check_kinds(export: Export) -> None:
    """Raise UnexpectedValue if an entry about messages names a service or parameter, or a topic that each relay publishes itself."""
    if export.parameters or export.services:
        raise UnexpectedValue(
            "only topics and actions in an entry with 'rate', 'newest' or 'frames', which are about messages: put the others into an entry of "
            "their own"
        )
    if not export.namespace and DIAGNOSTICS in export.topics:
        raise UnexpectedValue(
            f"another name for {DIAGNOSTICS} by 'as' if a relay takes it across, since each relay publishes it itself"
        )


def _check_way_back(export: Export) -> None:
    """Raise UnexpectedValue if a way back is named that no relay has."""
    if export.back and not export.is_relayed:
        raise UnexpectedValue(
            f"'back' with 'as', 'rate', 'newest' or 'frames', but it has only {export.back[0]}: without these the other robot gives it "
            "by its own multimaster_exports"
        )
    if DIAGNOSTICS in export.back:
        raise UnexpectedValue(f"no {DIAGNOSTICS} at 'back', since each relay publishes it itself")


def _read_relay(entry: Mapping[Any, Any]) -> dict[str, Any]:
    """Read the keys that make an entry one of the relay."""
    namespace, rate, newest = entry.get("as", ""), entry.get("rate", 0), entry.get("newest", False)
    frames = entry.get("frames", "")
    if "as" in entry and (not isinstance(namespace, str) or not _WHOLE_NAME.fullmatch(namespace)):
        raise UnexpectedValue(f"a namespace such as /kobuki1 at 'as', or a name, but there is '{namespace}'")
    number = isinstance(rate, (int, float)) and not isinstance(rate, bool)
    if "rate" in entry and not (number and 0 < rate <= FASTEST):
        raise UnexpectedValue(f"messages a second above 0, up to {FASTEST:g}, at 'rate', but there is '{rate}'")
    if not isinstance(newest, bool):
        raise UnexpectedValue(f"true or false at 'newest', but there is '{newest}'")
    if "frames" in entry and (not isinstance(frames, str) or not _PREFIX.fullmatch(frames)):
        raise UnexpectedValue(
            f"a prefix without a leading / that ends with / or _, such as robot1/, at 'frames', but there is '{frames}'"
        )
    whole = _read_types(entry["whole"], "rate" in entry) if "whole" in entry else ()
    return {"namespace": str(namespace), "rate": float(rate), "newest": newest, "frames": str(frames), "whole": whole}


def _read_types(value: Any, has_rate: bool) -> tuple[str, ...]:
    """Read the types at 'whole'."""
    if not has_rate:
        raise UnexpectedValue("'whole' only with 'rate': it lists the types of which the newest message is enough")
    texts = value if isinstance(value, list) else [value]
    wrong = [text for text in texts if not isinstance(text, str) or not _TYPE.fullmatch(text)]
    if value != texts or wrong or len(texts) > MOST_TYPES:
        raise UnexpectedValue(
            f"a list of at most {MOST_TYPES} types of messages at 'whole', such as [my_msgs/Status] or [my_msgs/*], but there is '{(wrong or [value])[0]}'"
        )
    return tuple(texts)


#: The value of `multimaster_frames` if something else publishes how the robots' frames are connected.
EXTERNAL = "external"
_FRAME = re.compile(r"[A-Za-z][A-Za-z0-9_/]*")


def read_frames(value: Any) -> tuple[str, str]:
    """Read `multimaster_frames`: the world and the root of the robot's tree; two empty texts if something else publishes it. Raises UnexpectedValue."""
    if value == EXTERNAL:
        return "", ""
    items = list(value.items()) if isinstance(value, Mapping) else []
    if len(items) != 1 or not all(isinstance(text, str) and _FRAME.fullmatch(text) for text in items[0]):
        raise UnexpectedValue(
            f"the frame of all robots with the root of this robot's tree, such as {{world: map}}, or {EXTERNAL}, if something else "
            "publishes how they hang together"
        )
    return str(items[0][0]), str(items[0][1])


def _read_texts(key: str, items: Any) -> tuple[str, ...]:
    if not isinstance(items, (list, tuple)) or not all(isinstance(item, str) and item for item in items):
        raise UnexpectedValue(f"a list of {'robots' if key == 'to' else 'names'} at '{key}', such as " + _SUCH_AS[key])
    return tuple(str(item) for item in items)


_SUCH_AS = {
    "topics": "[/tibi/pose]",
    "services": "[/tibi/reset]",
    "actions": "[/tibi/dock]",
    "parameters": "[/robot_description]",
    "back": "[/cmd_vel]",
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
    if not _WHOLE_NAME.fullmatch(name) or len(name) > _LONGEST:
        raise UnexpectedValue(
            "whole names of letters, digits, '_' and '/' at 'parameters', since a name has all that is below it, too, but there is "
            f"'{name}'"
        )
    if "/" + name.split("/")[1] in NEVER_CROSSING:
        raise UnexpectedValue(
            f"parameters of the robot's own nodes at 'parameters', but there is '{name}', which belongs to the roscore or to the exchange "
            "itself"
        )
