# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The answer of a robot, taken as data: documented keys of documented types, within bounds, and plain text. Pure.

A robot and its Python may be in foreign hands. So its answer gives Ansible no orders (`add_host`, `ansible_facts`).
It has no types of Ansible's own. Its size and its depth have bounds, which the controller can hold.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Iterator, Mapping
from typing import Any, NamedTuple

from .._base.plain_text import LINE, VALUE, plain, plain_lines, quote
from .documentation import DIFFERENCE, DIFFERENCES, Answer, ValueType

MOST_TEXT = 16 << 20  # characters of an answer
MOST_VALUES = 1_000_000
DEEPEST = 24  # lists and mappings in each other
DIGITS = 20  # of a number: 64 bits
NAME = 80  # characters of a name that is quoted

#: Keys that give Ansible orders. No module of ours answers them.
ORDERS = frozenset(("add_host", "add_group", "ansible_facts", "ansible_stats", "ansible_module_results"))
INTERNAL = "_ansible_"
TAG = "__ansible_type"  # a value of a type of Ansible's own, from ansible-core 2.19 on
#: Keys that Ansible's part of a module adds. Its messages become plain texts. The options are known to the controller.
MESSAGES = ("warnings", "deprecations")
TRACE, OPTIONS, CHANGES = "exception", "invocation", "diff"
#: about the file in an answer with a `path`
FILE_FACTS = ("uid", "gid", "owner", "group", "mode", "state", "size", "secontext")

# By Ansible's part of a module, before ours begins: which Python it needs, and which one is there.
_OLD_PYTHON = re.compile(r"Python3? (?:version )?(3\.\d{1,2})\b[^{}\"]{0,40}Current version: (3\.\d{1,2})\b")

Result = dict[str, Any]


class StrangeAnswer(ValueError):
    """The text is no answer of the module. The message is a part of a sentence: the found value."""


class CheckedAnswer(NamedTuple):
    """The part of an answer that the controller takes."""

    result: Result
    trace: str  # the traceback of a module that crashed
    left_out: list[str]  # the keys that the module does not document


def find_answer(output: str) -> str:
    """Return the line of an output that is the answer of a module; without an answer an empty text.

    Shells and loggers may have written before and after it.
    """
    lines = (line.strip() for line in reversed(output.splitlines()))
    return next((line for line in lines if line.startswith("{") and line.endswith("}")), "")


class OldPython(NamedTuple):
    """The Python of a robot that is too old for the ansible-core of the controller: "3.8" where "3.9" is needed."""

    needed: str
    found: str


def find_old_python(text: str) -> OldPython | None:
    """Return the Python of a robot where Ansible's part of a module says that it is too old; else None."""
    said = _OLD_PYTHON.search(text) if len(text) < LINE else None
    return OldPython(*said.groups()) if said else None


def check_answer(text: str, answer: Answer) -> CheckedAnswer:
    """Return the documented part of the text that a robot has answered. Raises StrangeAnswer."""
    data = _parse(text)
    _refuse_orders(data)
    reader = _AnswerReader()
    result = {name: reader.read_value(kind, data[name], name) for name, kind in answer.items() if name in data}
    _refuse_gaps(result, answer)
    if CHANGES in data:
        kind = DIFFERENCES if isinstance(data[CHANGES], list) else DIFFERENCE
        result[CHANGES] = _AnswerReader(plain_lines).read_value(kind, data[CHANGES], CHANGES)
    warnings = [plain(text, LINE) for name in MESSAGES for text in _messages(data.get(name))]
    if warnings:
        result["warnings"] = warnings
    trace = "\n".join(_messages(data.get(TRACE)))
    if result.get("failed"):
        result.setdefault("msg", plain((trace.strip().splitlines() or ["it does not say why"])[-1], LINE))
    known = {*answer, *MESSAGES, CHANGES, TRACE, OPTIONS, *(FILE_FACTS if "path" in answer else ())}
    more = [quote(name, NAME) for name in data if name not in known]
    return CheckedAnswer(result, plain_lines(trace), reader.left_out + more)


def _refuse_orders(data: Mapping[str, Any]) -> None:
    """Raise StrangeAnswer if there is a key by which Ansible would do something."""
    orders = sorted(name for name in data if name in ORDERS or name.startswith(INTERNAL))
    if orders:
        raise StrangeAnswer(f"the key {quote(orders[0], NAME)}, which no module of the collection answers")


def _refuse_gaps(result: Result, answer: Answer) -> None:
    """Raise StrangeAnswer if a promised value is missing. An answer that is skipped promises nothing."""
    failed = bool(result.get("failed"))
    missing = [name for name, kind in answer.items() if _is_promised(kind, failed) and result.get(name) is None]
    if missing and not result.get("skipped"):
        raise StrangeAnswer(f"no {missing[0]}")


def _is_promised(kind: ValueType, failed: bool) -> bool:
    """Return True if each answer has a value of this kind. A single text or number may be missing all the same."""
    words = ("always",) if failed else ("always", "success")
    return kind.returned in words and kind.type in ("bool", "dict", "list")


def _parse(text: str) -> Mapping[str, Any]:
    """Read the JSON of a stranger. Its signs bound its cost before it is read: each value begins with one of them."""
    if len(text) > MOST_TEXT:
        raise StrangeAnswer(f"{len(text)} characters")
    values = sum(map(text.count, "[{,"))
    if values > MOST_VALUES:
        raise StrangeAnswer(f"{values} values")
    try:
        data = json.loads(text, parse_int=_parse_integer, parse_float=_parse_number, parse_constant=_parse_number)
    except RecursionError:
        raise StrangeAnswer("values too deep in each other") from None
    except ValueError as problem:
        raise StrangeAnswer(problem if isinstance(problem, StrangeAnswer) else "no JSON") from None
    if not isinstance(data, Mapping):
        raise StrangeAnswer("no mapping")
    return data


def _parse_integer(digits: str) -> int:
    if len(digits) > DIGITS:
        raise StrangeAnswer(f"a number of {len(digits)} digits")
    return int(digits)


def _parse_number(digits: str) -> float:
    number = float(digits) if len(digits) <= LINE else math.inf
    if not math.isfinite(number):
        raise StrangeAnswer(f"{quote(digits, NAME)}, which is no finite number")
    if abs(number) >= 10**DIGITS:  # results with it could be infinite, and would cost the whole report
        raise StrangeAnswer(f"a number of more than {DIGITS} digits")
    return number


def _messages(value: Any) -> Iterator[str]:
    """Yield the texts of messages: texts, mappings with `msg`, or with an `event` that has it (ansible-core 2.19)."""
    for entry in value if isinstance(value, list) else [value]:
        for _step in range(2):
            if isinstance(entry, Mapping):
                entry = entry.get("formatted_traceback") or entry.get("msg") or entry.get("event")
        if isinstance(entry, str):
            yield entry


class _AnswerReader:
    """Reads values by their kinds, and notes the keys that it leaves out. Only the texts of differences have several lines."""

    def __init__(self, clean: Callable[[str, int], str] = plain) -> None:
        self.left_out: list[str] = []
        self._clean = clean

    def read_value(self, kind: ValueType, data: Any, place: str, depth: int = 1) -> Any:
        """Return a value of this kind. None fits every kind. Raises StrangeAnswer."""
        if depth > DEEPEST:
            raise StrangeAnswer(f"values more than {DEEPEST} deep in each other at {place}")
        if data is None:
            return None
        if kind.type != "raw" and not _fits(kind.type, data):
            raise StrangeAnswer(f"{_word(data)} at {place}; the module answers {_KINDS[kind.type][0]}")
        if isinstance(data, str):
            return self._clean(data, VALUE)
        if isinstance(data, list):
            item = kind.each or ValueType("raw")
            return [self.read_value(item, part, f"{place}[{at}]", depth + 1) for at, part in enumerate(data)]
        if isinstance(data, Mapping):
            return self._read_mapping(kind, data, place, depth)
        return data

    def _read_mapping(self, kind: ValueType, data: Mapping[str, Any], place: str, depth: int) -> Result:
        if TAG in data:
            raise StrangeAnswer(f"a type of Ansible's own at {place}")
        if kind.parts is None:
            item = kind.each or ValueType("raw")
            return {
                plain(name, LINE): self.read_value(item, part, f"{place}.{quote(name, NAME)}", depth + 1)
                for name, part in data.items()
            }
        self.left_out += [f"{place}.{quote(name, NAME)}" for name in data if name not in kind.parts]
        return {
            name: self.read_value(part, data[name], f"{place}.{name}", depth + 1)
            for name, part in kind.parts.items()
            if name in data
        }


#: kind -> its name in a sentence, and its types; a whole number is a number, so the kind of a value is the first that fits
_KINDS: Mapping[str, tuple[str, tuple[type, ...]]] = {
    "str": ("a text", (str,)),
    "float": ("a number", (int, float)),
    "int": ("a whole number", (int,)),
    "bool": ("true or false", (bool,)),
    "list": ("a list", (list,)),
    "dict": ("a mapping", (dict,)),
}


def _fits(kind: str, data: Any) -> bool:
    return isinstance(data, _KINDS[kind][1]) and (kind == "bool" or not isinstance(data, bool))


def _word(data: Any) -> str:
    return next(word for kind, (word, _types) in _KINDS.items() if _fits(kind, data))
