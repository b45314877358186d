# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The limits of a roscore, and the weight of a value: the table BOUNDS, which docs/understand/roscore.md has too.

Every program that reaches its port may call it. Whatever a caller sends, the process stays below the memory of its unit
(MemoryMax). So does the next process, which reads all of it again.
"""

import re
from typing import Any, Dict, Iterable, NamedTuple, Sequence, Tuple

from ...protocol.json_text import UNWRITABLE
from .owners import descend
from .registry import USERS, Record, split_name

MIB = 1 << 20


class Limit(NamedTuple):
    """One row: the most that is taken, and its unit."""

    most: int
    what: str


BOUNDS: Dict[str, Limit] = {
    "request": Limit(32 * MIB, "bytes of a request, also when it is unpacked"),
    "values": Limit(48 * MIB, "bytes of memory of the values in a request"),
    "text": Limit(16 * MIB, "bytes of one text"),
    "elements": Limit(100, "elements of XML in each other: a list in a list has three"),
    "depth": Limit(64, "levels of a parameter: the parts of its name, and the lists and mappings in each other"),
    "name": Limit(512, "characters of a name, a type or a URI"),
    "parameter": Limit(32 * MIB, "bytes of one parameter"),
    "parameters": Limit(64 * MIB, "bytes of all parameters together"),
    "parameters of one": Limit(
        16 * MIB,
        "bytes of the parameters that another robot has set; a half of all is kept for this robot, and an eighth for the others, a part for each",
    ),
    "watched": Limit(4 * MIB, "bytes of a parameter that others hear of: the record of imports, and /do_not_sync"),
    "registrations": Limit(256 * MIB, "bytes of all registrations together; one counts 1,500 and its names"),
    "registrations of one": Limit(
        32 * MIB,
        "bytes of the registrations that another robot has made; a half of all is kept for this robot, and an eighth for the others, a part for each",
    ),
    "users": Limit(20_000, "publishers, subscribers or listeners of one name"),
    "calls": Limit(100_000, "calls in one system.multicall"),
    "together": Limit(1_000, "calls in one text of rosfleetTogether"),
    "answer": Limit(96 * MIB, "bytes of an answer"),
    "under way": Limit(
        512 * MIB,
        "bytes of memory for all large requests and answers at once, while they are under way; half of it for other computers, three eighths for a robot",
    ),
    "connections": Limit(
        800,
        "open connections; then the one that was idle longest ends, of another computer first; another robot has 200, all others together 600",
    ),
    "effort": Limit(
        25,
        "hundredths of a processor for another robot, and 50 for all others together, as soon as one has taken 5 seconds",
    ),
    "head": Limit(16 * 1024, "bytes of the head of a request"),
}

# The weight of a value: not less than it costs in memory, in the store and in an answer.
_NUMBER, _TEXT, _MEMBER, _LIST, _MAPPING = 60, 80, 120, 130, 240
_REGISTRATION = 1500

_DEAR = '<>&"\\\n\r\t'  # signs that XML or JSON writes as several
_ANY_DEAR = re.compile(f"[{re.escape(_DEAR)}]")
_TIME = re.compile(r"[-+0-9T:Z. ]{0,40}\Z")


class BoundRefusal(ValueError):
    """A call that is not carried out. `bound`: the row of the table that it exceeds, "" if it is no size."""

    def __init__(self, text: str, bound: str = "") -> None:
        super().__init__(text)
        self.bound = bound


def refuse(bound: str, whose: str) -> BoundRefusal:
    """Make the refusal of something that exceeds a bound."""
    most, what = BOUNDS[bound]
    shown = f"{most // MIB} MiB" if most >= MIB else f"{most:,}"
    return BoundRefusal(f"{whose} is more than the roscore takes: at most {shown} ({what})", bound)


def weigh(value: Any) -> int:
    """The weight of a value that was taken, or of an answer."""
    return _weigh(value, BOUNDS["depth"].most + 8, "")


def _weigh(value: Any, depth: int, name: str) -> int:
    if isinstance(value, str):
        return weigh_text(value)
    if isinstance(value, dict):
        if depth <= 0:
            raise refuse("depth", name)
        return _MAPPING + sum(
            _MEMBER + _weigh_key(key, name) + _weigh(part, depth - 1, name) for key, part in value.items()
        )
    if isinstance(value, (list, tuple)):
        if depth <= 0:
            raise refuse("depth", name)
        return _LIST + sum(_weigh(part, depth - 1, name) for part in value) + 10 * len(value)
    data = getattr(value, "data", None)
    if isinstance(data, bytes):  # xmlrpc.client.Binary
        return _LIST + 3 * len(data)
    time = getattr(value, "value", None)
    if isinstance(time, str) and not _TIME.match(time):  # xmlrpc.client.DateTime takes any text, and writes it as it is
        raise BoundRefusal(f"{name} has an invalid time")
    return _NUMBER if not isinstance(value, int) or -(2**63) <= value < 2**64 else _NUMBER + 800


def _weigh_key(key: Any, name: str) -> int:
    if not isinstance(key, str):
        raise BoundRefusal(f"{name} has a mapping with a name that is no text")
    return weigh_text(key)


def weigh_text(text: str) -> int:
    """The weight of a text."""
    size = len(text) if text.isascii() else 4 * len(text)
    return _TEXT + size + (5 * sum(map(text.count, _DEAR)) if _ANY_DEAR.search(text) else 0)


def is_writable(value: Any) -> bool:
    """True if XML can have each text in a value. JSON can have others. Raises RecursionError for a very deep one."""
    if isinstance(value, str):
        return not UNWRITABLE.search(value)
    if isinstance(value, dict):
        return all(map(is_writable, [*value, *value.values()]))
    return not isinstance(value, (list, tuple)) or all(map(is_writable, value))


# The sums


class Usage:
    """The weight of parameters and registrations, as sums that each change keeps right."""

    def __init__(self, spare: float = 1.0) -> None:
        """The bound of registrations counts `spare` times."""
        self.parameters, self.registrations, self._spare = _MAPPING, 0, spare
        self._single: Dict[
            Tuple[str, str], int
        ] = {}  # (kind, name) of the entries that each name has once: their weight

    def growth(self, tree: Dict[str, Any], name: str, value: Any) -> int:
        """The weight that this value adds to the tree of parameters. Raises BoundRefusal."""
        parts = split_name(name)
        if len(parts) > BOUNDS["depth"].most:
            raise refuse("depth", name)
        weight = _weigh(value, BOUNDS["depth"].most - len(parts), name)
        if weight > BOUNDS["parameter"].most and parts:
            raise refuse("parameter", name)
        growth = _growth(tree, parts, weight)
        if growth > 0 and self.parameters + growth > BOUNDS["parameters"].most:
            raise refuse("parameters", name)
        return growth

    def is_full(self, *texts: str) -> bool:
        """True if there is no room for one more registration with these texts."""
        return self.registrations + weigh_registration(*texts) > BOUNDS["registrations"].most * self._spare

    def count(self, record: Record) -> int:
        """Count a change: something that is new, or gone. Return its addition to the sum."""
        kind, name, before = record.kind, record.name, self.registrations
        if kind in USERS:
            self.registrations += weigh_record(record) * (1 if record.there else -1)
        elif kind in ("service", "node", "type"):
            self.registrations -= self._single.pop((kind, name), 0)
            if record.is_there:
                self._single[kind, name] = weigh_record(record)
                self.registrations += weigh_record(record)
        return self.registrations - before


# The tree of parameters


def _growth(tree: Dict[str, Any], parts: Sequence[str], new: int) -> int:
    """The weight that the tree gains by a parameter of the weight `new`, which replaces the value that is there."""
    if not parts:
        return new - weigh(tree)
    within, at = descend(tree, parts)
    new += sum(_MAPPING + _MEMBER + weigh_text(inner) for inner in parts[at + 1 :])
    return new - weigh(within[parts[at]]) if parts[at] in within else new + _MEMBER + weigh_text(parts[at])


def weigh_member(name: str, value: Any) -> int:
    """Return the bytes that a member of a mapping counts."""
    return _MEMBER + weigh_text(name) + weigh(value)


def weigh_parameter(tree: Dict[str, Any], name: str) -> int:
    """The weight of a parameter in its tree, 0 if it is not set."""
    parts = split_name(name)
    within, at = descend(tree, parts)
    if not parts or at < len(parts) - 1 or parts[-1] not in within:
        return 0
    return weigh_member(parts[-1], within[parts[-1]])


# Names


def check_names(texts: Iterable[Any], whole: bool = False) -> None:
    """Raise BoundRefusal if one of these names, types or URIs is too long. rosmaster answers values that are no text.

    `whole`: the names have the namespace of their caller in them.
    """
    most = (2 if whole else 1) * BOUNDS["name"].most + (2 if whole else 0)
    for text in texts:
        if isinstance(text, str) and len(text) > most:
            raise refuse("name", f"a name of {len(text):,} characters")


def weigh_record(record: Record) -> int:
    """Return the bytes that the registration in a record counts."""
    return weigh_registration(*record.texts) - (1000 if record.kind in ("node", "type") else 0)


def weigh_registration(*texts: str) -> int:
    """The weight of a registration."""
    return _REGISTRATION + sum(len(text) if text.isascii() else 4 * len(text) for text in texts)
