# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""What a roscore takes at most, and what a value counts: the table BOUNDS, which docs/understand/roscore.md has too.

Whoever reaches its port may call it. So whatever a caller sends, the process stays below the memory of its unit (MemoryMax),
and so does the next one, which reads all of it again.
"""

import re
from typing import Any, Dict, Iterable, List, NamedTuple, Sequence, Tuple

MIB = 1 << 20


class Bound(NamedTuple):
    """One row: the most that is taken, and what it counts."""

    most: int
    what: str


BOUNDS: Dict[str, Bound] = {
    "request": Bound(32 * MIB, "bytes of a request, also when it is unpacked"),
    "values": Bound(48 * MIB, "bytes of memory of the values in a request"),
    "text": Bound(16 * MIB, "bytes of one text"),
    "elements": Bound(100, "elements of XML in each other: a list in a list has three"),
    "depth": Bound(64, "levels of a parameter: the parts of its name, and the lists and mappings in each other"),
    "name": Bound(512, "characters of a name, a type or a URI"),
    "parameter": Bound(32 * MIB, "bytes of one parameter"),
    "parameters": Bound(64 * MIB, "bytes of all parameters together"),
    "watched": Bound(4 * MIB, "bytes of a parameter that others are told of: the record of imports, and /do_not_sync"),
    "registrations": Bound(256 * MIB, "bytes of all registrations together; one counts 1,500 and its names"),
    "users": Bound(20_000, "publishers, subscribers or listeners of one name"),
    "calls": Bound(100_000, "calls in one system.multicall"),
    "together": Bound(1_000, "calls in one text of rosfleetTogether"),
    "answer": Bound(96 * MIB, "bytes of an answer"),
    "under way": Bound(
        512 * MIB, "bytes of memory for all large requests and answers at once; half of it for other computers"
    ),
    "connections": Bound(800, "open connections; then the one that was idle longest ends, of another computer first"),
    "head": Bound(16 * 1024, "bytes of the head of a request"),
}

# What a value counts: not less than it costs in memory, in the store and in an answer.
_NUMBER, _TEXT, _MEMBER, _LIST, _MAPPING = 60, 80, 120, 130, 240
_REGISTRATION = 1500

_DEAR = '<>&"\\\n\r\t'  # signs that XML or JSON writes as several
_ANY_DEAR = re.compile(r'[<>&"\\\n\r\t]')
_UNWRITABLE = re.compile("[\0-\x08\x0b\x0c\x0e-\x1f\ud800-\udfff\ufffe\uffff]")  # XML has none of them
_TIME = re.compile(r"[-+0-9T:Z. ]{0,40}\Z")


class Beyond(ValueError):
    """More than is taken. `bound`: which row of the table, "" where it is no size."""

    def __init__(self, text: str, bound: str = "") -> None:
        super().__init__(text)
        self.bound = bound


def beyond(bound: str, whose: str) -> Beyond:
    """The refusal of something that is beyond a bound."""
    most = BOUNDS[bound]
    shown = f"{most.most // MIB} MiB" if most.most >= MIB else f"{most.most:,}"
    return Beyond(f"{whose} is more than the roscore takes: at most {shown} ({most.what})", bound)


def weight(value: Any) -> int:
    """What a value counts that has been taken, or an answer."""
    return _weight(value, BOUNDS["depth"].most + 8, "")


def _weight(value: Any, depth: int, name: str) -> int:
    if isinstance(value, str):
        return text_weight(value)
    if isinstance(value, dict):
        if depth <= 0:
            raise beyond("depth", name)
        return _MAPPING + sum(_MEMBER + _key(key, name) + _weight(part, depth - 1, name) for key, part in value.items())
    if isinstance(value, (list, tuple)):
        if depth <= 0:
            raise beyond("depth", name)
        return _LIST + sum(_weight(part, depth - 1, name) for part in value) + 10 * len(value)
    data = getattr(value, "data", None)
    if isinstance(data, bytes):  # xmlrpc.client.Binary
        return _LIST + 3 * len(data)
    time = getattr(value, "value", None)
    if isinstance(time, str) and not _TIME.match(time):  # xmlrpc.client.DateTime takes any text, and writes it as it is
        raise Beyond(f"{name} has a time that is none")
    return _NUMBER if not isinstance(value, int) or -(2**63) <= value < 2**64 else _NUMBER + 800


def _key(key: Any, name: str) -> int:
    if not isinstance(key, str):
        raise Beyond(f"{name} has a mapping with a name that is no text")
    return text_weight(key)


def text_weight(text: str) -> int:
    """What a text counts."""
    size = len(text) if text.isascii() else 4 * len(text)
    return _TEXT + size + (5 * sum(map(text.count, _DEAR)) if _ANY_DEAR.search(text) else 0)


def writable(values: Iterable[Any]) -> bool:
    """True where every text among these values is one that XML can have: what came in JSON may have others."""
    stack = list(values)
    while stack:
        value = stack.pop()
        if isinstance(value, str):
            if _UNWRITABLE.search(value):
                return False
        elif isinstance(value, dict):
            stack += value.keys()
            stack += value.values()
        elif isinstance(value, (list, tuple)):
            stack += value
    return True


# The sums


class Room:
    """What there is of parameters and registrations, as a sum that each change keeps right."""

    def __init__(self, spare: float = 1.0) -> None:
        """`spare`: how many times as much as the bound says there is room for registrations."""
        self.parameters, self.registrations, self._spare = _MAPPING, 0, spare
        self._single: Dict[Tuple[str, str], int] = {}  # things of which each name has one: what they count

    def set(self, tree: Dict[str, Any], name: str, value: Any) -> int:
        """How much heavier the tree of parameters gets with this value. Raises Beyond."""
        parts = parts_of(name)
        weight = _weight(value, BOUNDS["depth"].most - len(parts), name)
        if weight > BOUNDS["parameter"].most and parts:
            raise beyond("parameter", name)
        grown = _grown(tree, parts, weight)
        if grown > 0 and self.parameters + grown > BOUNDS["parameters"].most:
            raise beyond("parameters", name)
        return grown

    def is_full(self, *texts: str) -> bool:
        """True where there is no room for one more registration with these texts."""
        return self.registrations + registration(*texts) > BOUNDS["registrations"].most * self._spare

    def count(self, record: List[Any]) -> None:
        """Count a change: a registration that is new, or gone."""
        kind, name = record[:2]
        if kind in ("publisher", "subscriber", "listener"):
            self.registrations += registration(*record[1:4]) * (1 if record[4] else -1)
        elif kind in ("service", "node", "type"):
            there = record[-1] if kind == "service" else record[2]
            self.registrations -= self._single.pop((kind, name), 0)
            if there:
                texts = [part for part in record[1:] if isinstance(part, str)]
                cost = self._single[kind, name] = registration(*texts) - (0 if kind == "service" else 1000)
                self.registrations += cost

    def forget(self, kind: str, name: str) -> None:
        """Something of which each name has one is gone."""
        self.registrations -= self._single.pop((kind, name), 0)


# The tree of parameters


def parts_of(name: str) -> List[str]:
    """The parts of the name of a parameter."""
    return [part for part in name.split("/") if part]


def _grown(tree: Dict[str, Any], parts: Sequence[str], new: int) -> int:
    """How much heavier the tree gets when a parameter is set to a value of this weight; what is there goes."""
    if not parts:
        return new - weight(tree)
    within = tree
    for at, part in enumerate(parts):
        held = within.get(part)
        if isinstance(held, dict) and at + 1 < len(parts):
            within = held
            continue
        new += sum(_MAPPING + _MEMBER + text_weight(inner) for inner in parts[at + 1 :])
        return new - weight(held) if part in within else new + _MEMBER + text_weight(part)
    return 0


def freed(tree: Dict[str, Any], name: str) -> int:
    """How much lighter the tree gets when a parameter is deleted."""
    parts, within = parts_of(name), tree
    for part in parts[:-1]:
        within = within.get(part, {})
        if not isinstance(within, dict):
            return 0
    if not parts or parts[-1] not in within:
        return 0
    return _MEMBER + text_weight(parts[-1]) + weight(within[parts[-1]])


# Names


def names(texts: Iterable[Any], whole: bool = False) -> None:
    """Raise Beyond where one of these names, types or URIs is too long. What is no text has its answer from rosmaster.

    `whole`: names are with the namespace that was the caller's.
    """
    most = (2 if whole else 1) * BOUNDS["name"].most + (2 if whole else 0)
    for text in texts:
        if isinstance(text, str) and len(text) > most:
            raise beyond("name", f"a name of {len(text):,} characters")


def registration(*texts: str) -> int:
    """What a registration counts."""
    return _REGISTRATION + sum(len(text) if text.isascii() else 4 * len(text) for text in texts)
