# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""What a robot answers is data: the documented keys of documented types, within bounds, and plain text. Pure.

A robot may be in foreign hands, and then so is its Python. So its answer gives no orders to Ansible (`add_host`,
`ansible_facts`), has no types of Ansible's own, and is not larger or deeper than what the controller can hold.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator, Mapping
from typing import Any, NamedTuple

from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._answers.documented import (
    DIFFERENCE,
    DIFFERENCES,
    Answer,
    Kind,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._fleet.plain_text import (
    LINE,
    VALUE,
    plain,
    plain_lines,
    quote,
)

MOST_TEXT = 16 << 20  # characters of an answer
MOST_VALUES = 1_000_000
DEEPEST = 24  # lists and mappings in each other
DIGITS = 20  # of a whole number: 64 bits
NAME = 80  # characters of a name that is quoted

#: With these Ansible is told what to do. No module of ours answers them.
ORDERS = frozenset(("add_host", "add_group", "ansible_facts", "ansible_stats", "ansible_module_results"))
INTERNAL = "_ansible_"
TAG = "__ansible_type"  # a value of a type of Ansible's own, from ansible-core 2.19 on
#: What Ansible's part of a module adds: its messages become plain texts, the options are known anyway.
MESSAGES = ("warnings", "deprecations")
TRACE, OPTIONS, SHOWN = "exception", "invocation", "diff"

Result = dict[str, Any]


class Strange(ValueError):
    """The text is no answer of the module; a part of a sentence: what was found."""


class Taken(NamedTuple):
    """An answer."""

    result: Result
    trace: str  # the traceback of a module that crashed
    left_out: list[str]  # the keys that the module does not document


def found_in(output: str) -> str:
    """Return the line of an output that is the answer of a module, and an empty text where none is.

    Before and after it, shells and loggers may have written something.
    """
    lines = (line.strip() for line in reversed(output.splitlines()))
    return next((line for line in lines if line.startswith("{") and line.endswith("}")), "")


def taken(text: str, answer: Answer) -> Taken:
    """Return what a robot has answered, as the module documents it. Raises Strange."""
    said = _read(text)
    _refuse_orders(said)
    reader = _Reader()
    result = {name: reader.value(kind, said[name], name) for name, kind in answer.items() if name in said}
    _refuse_less(result, answer)
    if SHOWN in said:
        result[SHOWN] = reader.shown(said[SHOWN])
    warnings = [plain(text, LINE) for name in MESSAGES for text in _messages(said.get(name))]
    if warnings:
        result["warnings"] = warnings
    trace = "\n".join(_messages(said.get(TRACE)))
    if result.get("failed"):
        result.setdefault("msg", plain((trace.strip().splitlines() or ["it does not say why"])[-1], LINE))
    known = {*answer, *MESSAGES, SHOWN, TRACE, OPTIONS}
    more = [quote(name, NAME) for name in said if name not in known]
    return Taken(result, plain_lines(trace), reader.left_out + more)


def _refuse_orders(said: Mapping[str, Any]) -> None:
    orders = sorted(name for name in said if name in ORDERS or name.startswith(INTERNAL))
    if orders:
        raise Strange(f"the key {quote(orders[0], NAME)}, which no module of the collection answers")


def _refuse_less(result: Result, answer: Answer) -> None:
    """Raise Strange where a value is missing that is in each answer; of one that is skipped nothing is."""
    failed = bool(result.get("failed"))
    missing = [name for name, kind in answer.items() if _promised(kind, failed) and result.get(name) is None]
    if missing and not result.get("skipped"):
        raise Strange(f"no {missing[0]}")


def _promised(kind: Kind, failed: bool) -> bool:
    """Return True where a value of this kind is in each answer; a lone text or number may be nothing all the same."""
    words = ("always",) if failed else ("always", "success")
    return kind.returned in words and kind.type in ("bool", "dict", "list")


def _read(text: str) -> Mapping[str, Any]:
    """Read the JSON of a stranger. Its cost is known before it is read: not more values than signs that begin one."""
    if len(text) > MOST_TEXT:
        raise Strange(f"{len(text)} characters")
    values = sum(map(text.count, "[{,"))
    if values > MOST_VALUES:
        raise Strange(f"{values} values")
    try:
        said = json.loads(text, parse_int=_whole, parse_float=_finite, parse_constant=_finite)
    except RecursionError:
        raise Strange("values too deep in each other") from None
    except ValueError as problem:
        raise Strange(problem if isinstance(problem, Strange) else "no JSON") from None
    if not isinstance(said, Mapping):
        raise Strange("no mapping")
    return said


def _whole(digits: str) -> int:
    if len(digits) > DIGITS:
        raise Strange(f"a number of {len(digits)} digits")
    return int(digits)


def _finite(digits: str) -> float:
    number = float(digits) if len(digits) <= LINE else math.inf
    if not math.isfinite(number):
        raise Strange(f"{quote(digits, NAME)}, which is no finite number")
    return number


def _messages(value: Any) -> Iterator[str]:
    """Yield the texts of messages: texts, mappings with `msg`, or with an `event` that has it (ansible-core 2.19)."""
    for entry in value if isinstance(value, list) else [value]:
        for _step in range(2):
            if isinstance(entry, Mapping):
                entry = entry.get("formatted_traceback") or entry.get("msg") or entry.get("event")
        if isinstance(entry, str):
            yield entry


class _Reader:
    """Reads values by their kinds, and notes what is left out."""

    def __init__(self) -> None:
        self.left_out: list[str] = []
        self._text: Callable[[str], str] = lambda text: plain(text, VALUE)

    def shown(self, said: Any) -> Any:
        """Return what changes, for --diff: these texts alone have lines. Raises Strange."""
        lines = _Reader()
        lines._text = lambda text: plain_lines(text, VALUE)
        return lines.value(DIFFERENCES if isinstance(said, list) else DIFFERENCE, said, SHOWN)

    def value(self, kind: Kind, said: Any, place: str, depth: int = 1) -> Any:
        """Return a value of this kind; nothing is one of every kind. Raises Strange."""
        if depth > DEEPEST:
            raise Strange(f"values more than {DEEPEST} deep in each other at {place}")
        if said is None:
            return None
        if kind.type == "raw":
            return self._any(said, place, depth)
        if not _fits(kind.type, said):
            raise Strange(f"{_word(said)} at {place}, where the module answers {_WORDS[kind.type]}")
        if isinstance(said, str):
            return self._text(said)
        if isinstance(said, list):
            item = kind.each or Kind("raw")
            return [self.value(item, part, f"{place}[{at}]", depth + 1) for at, part in enumerate(said)]
        if isinstance(said, Mapping):
            return self._mapping(kind, said, place, depth)
        return said

    def _mapping(self, kind: Kind, said: Mapping[str, Any], place: str, depth: int) -> Result:
        if TAG in said:
            raise Strange(f"a type of Ansible's own at {place}")
        if kind.parts is None:
            item = kind.each or Kind("raw")
            return {
                plain(name, LINE): self.value(item, part, f"{place}.{quote(name, NAME)}", depth + 1)
                for name, part in said.items()
            }
        self.left_out += [f"{place}.{quote(name, NAME)}" for name in said if name not in kind.parts]
        parts = kind.parts.items()
        return {
            name: self.value(part, said[name], f"{place}.{name}", depth + 1) for name, part in parts if name in said
        }

    def _any(self, said: Any, place: str, depth: int) -> Any:
        kind = "list" if isinstance(said, list) else "dict" if isinstance(said, Mapping) else ""
        if kind:
            return self.value(Kind(kind), said, place, depth)
        return self._text(said) if isinstance(said, str) else said


_TYPES: Mapping[str, tuple[type, ...]] = {
    "str": (str,),
    "int": (int,),
    "float": (int, float),
    "bool": (bool,),
    "list": (list,),
    "dict": (dict,),
}
_WORDS = {
    "str": "a text",
    "int": "a whole number",
    "float": "a number",
    "bool": "true or false",
    "list": "a list",
    "dict": "a mapping",
}


def _fits(kind: str, said: Any) -> bool:
    return isinstance(said, _TYPES[kind]) and (kind == "bool" or not isinstance(said, bool))


def _word(said: Any) -> str:
    kinds = (("true or false", bool), ("a text", str), ("a number", (int, float)), ("a list", list))
    return next((word for word, types in kinds if isinstance(said, types)), "a mapping")
