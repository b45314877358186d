# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Rules on their way to another computer: the list that masterInfoFiltered takes, and what its patterns may cost."""

import re
import reprlib
from functools import lru_cache
from math import comb
from typing import Any, List

from .filters import CACHED, MAX_NAME, MAX_TEXT, NAMES, WHITE_LISTS, InvalidPattern, Pattern, Rules, check_pattern

try:
    from re import _parser  # type: ignore[attr-defined]  # Python 3.11 and later, undocumented
except ImportError:
    import sre_parse as _parser

MAX_COST = 5_000_000  # steps of one match of a pattern from another computer: about 0.1 s, in which nothing else runs
_ON_THE_WIRE = NAMES[:10]  # as upstream reads them; further ones apply here only


def write_rules(rules: Rules, sync_remote_nodes: bool) -> List[Any]:
    """The list that masterInfoFiltered takes.

    The other master may refuse a costly pattern, so that one is left empty. All rules are applied again here.
    """
    texts = {name: getattr(rules, name).text for name in _ON_THE_WIRE}
    costly = {name for name, text in texts.items() if len(text) > MAX_TEXT or not _is_cheap(text)}
    if sum(map(len, texts.values())) > MAX_TEXT:
        costly = set(_ON_THE_WIRE)
    if costly.intersection(WHITE_LISTS):  # one of them without another would admit less
        costly.update(WHITE_LISTS)
    return [sync_remote_nodes, *("" if name in costly else text for name, text in texts.items())]


def read_rules(value: Any) -> Rules:
    """The rules of another computer: 8 to 11 elements, the first is sync_remote_nodes. Raises InvalidPattern."""
    if not isinstance(value, (list, tuple)) or not 8 <= len(value) <= 11:
        raise InvalidPattern("the filter is no array of 8 to 11 elements")
    if sum(len(text) for text in value[1:] if isinstance(text, str)) > MAX_TEXT:
        raise InvalidPattern(f"the patterns are longer than {MAX_TEXT} characters")
    return Rules(**{name: read_pattern(text) for name, text in zip(_ON_THE_WIRE, value[1:])})


def read_pattern(text: Any) -> Pattern:
    """The pattern of another computer. Raises InvalidPattern, also where it would be too costly."""
    if not isinstance(text, str):
        raise InvalidPattern(f"{reprlib.repr(text)} is no text")
    check_pattern(text, "the pattern", _limit_cost)
    return Pattern(text)


def _limit_cost(text: str) -> None:
    if not _is_cheap(text):
        raise InvalidPattern("the pattern would be too costly: it has too many repetitions, or one in another")


def _is_cheap(text: str) -> bool:
    return (_is_cheap_once if len(text) <= CACHED else _is_cheap_once.__wrapped__)(text)


@lru_cache(maxsize=64)
def _is_cheap_once(text: str) -> bool:
    return _cost(_parser.parse(text, re.IGNORECASE)) <= MAX_COST


def _cost(tree: Any) -> int:
    """Steps of the worst match: n choices one after the other can divide a name in so many ways.

    The alternatives of the whole pattern are tried one after the other, so their costs add up.
    """
    parts = list(tree)
    if parts and str(parts[-1][0]) == "BRANCH":  # what all alternatives begin with stands before them
        return sum(_cost([*parts[:-1], *branch]) for branch in parts[-1][1][1])
    choices = _choices(parts)
    return comb(MAX_NAME + choices, choices) if choices < _MANY else MAX_COST + 1


_MANY = 7  # choices that are too many in any case


def _choices(tree: Any) -> int:
    """Number of choices that follow each other in a pattern. A repeated one counts as often, or as too many."""
    count = 0
    for operation, argument in tree:
        name = str(operation)
        if "REPEAT" in name:
            low, high, inner = argument
            count += _choices(inner) * min(high, _MANY) + (1 if low != high else 0)
        elif name == "BRANCH":
            count += max(_choices(branch) for branch in argument[1]) + (len(argument[1]).bit_length() + 3) // 4
        elif name == "SUBPATTERN":
            count += _choices(argument[-1])
        elif name == "ATOMIC_GROUP":
            count += _choices(argument)
        elif name in ("ASSERT", "ASSERT_NOT"):
            count += _choices(argument[1])
        elif name == "IN":  # names are ASCII, and a wide range takes long to compile
            count += _MANY * any(str(kind) == "RANGE" and value[1] > 0xFF for kind, value in argument)
        elif name in ("GROUPREF", "GROUPREF_EXISTS", "GROUPREF_IGNORE"):
            count += _MANY
    return count
