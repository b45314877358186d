# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Rules on their way to another computer: the list that masterInfoFiltered takes.

On the way each filter is the text of a regular expression, since upstream compiles it: its patterns, each anchored, as
alternatives. Nothing of that is compiled here. A text of exactly the form that the patterns of names with `*` get, here and
upstream, is read back into these: `\\A/tf.*\\Z|\\A/map\\Z` is `/tf*` and `/map`. Of any other text nothing is known, and it
means no filter: the caller applies all of its rules itself to its answer, so more travels, and nothing is lost. It is
so for an ignore list, of which less is ignored then. White lists restrict each other's names (a name that is in one of them
is wanted), so with one of them all are left out.
"""

import reprlib
from typing import Any, Dict, List, Optional

from .filters import MAX_STARRED, MAX_TEXT, NAMES, NO_NAME, WHITE_LISTS, InvalidPattern, Pattern, Rules, is_expression

_ON_THE_WIRE = NAMES[:10]  # as upstream reads them; further ones apply here only
_BEGIN, _END, _ANY = ("\\A", "^"), ("\\Z", "$"), ".*"  # an anchored pattern, and its `*`


def write_rules(rules: Rules, sync_remote_nodes: bool) -> List[Any]:
    """The list that masterInfoFiltered takes.

    It has only the names with `*`, and not more than another computer takes of them. All rules are applied again here.
    """
    patterns: Dict[str, Optional[Pattern]] = {}
    for name in _ON_THE_WIRE:
        items = getattr(rules, name).items
        patterns[name] = Pattern(tuple(item for item in items if not is_expression(item)))
        if name in WHITE_LISTS and any(map(is_expression, items)):
            patterns[name] = None
    sent = _join(patterns)
    return [sync_remote_nodes, *(_write(getattr(sent, name)) for name in _ON_THE_WIRE)]


def read_rules(value: Any) -> Rules:
    """The rules of another computer: 8 to 11 elements, the first is sync_remote_nodes. Raises InvalidPattern."""
    if not isinstance(value, (list, tuple)) or not 8 <= len(value) <= 11:
        raise InvalidPattern("the filter is no array of 8 to 11 elements")
    for text in value[1:]:
        if not isinstance(text, str):
            raise InvalidPattern(f"{reprlib.repr(text)} is no text")
    return _join({name: read_pattern(text) for name, text in zip(_ON_THE_WIRE, value[1:])})


def read_pattern(text: str) -> Optional[Pattern]:
    """The pattern that is written so; None for any other text. It takes one step for each character."""
    if not text:
        return Pattern()
    if len(text) > MAX_TEXT:
        return None
    items = [_read_item(part) for part in text.split("|")]
    return Pattern(tuple(filter(None, items))) if all(items) else None


def _read_item(part: str) -> str:
    """The pattern in one alternative, "" if it has another form."""
    begin = next(filter(part.startswith, _BEGIN), "")
    end = next(filter(part.endswith, _END), "")
    inner = part[len(begin) : len(part) - len(end)]
    if not begin or not end or inner == NO_NAME:
        return inner if begin and end else ""
    pieces = inner.split(_ANY)
    return "" if any("*" in piece or is_expression(piece) for piece in pieces) else "*".join(pieces)


def _write(pattern: Pattern) -> str:
    return "|".join(rf"\A{item.replace('*', _ANY)}\Z" for item in pattern.items)


def _join(patterns: Dict[str, Optional[Pattern]]) -> Rules:
    """The rules of these patterns. None: it is not known, so it restricts nothing, and so do patterns that are too many."""
    known = {name: pattern for name, pattern in patterns.items() if pattern is not None}
    sizes = [
        sum(len(_write(pattern)) for pattern in known.values()),
        sum(pattern.starred for pattern in known.values()),
    ]
    if sizes[0] > MAX_TEXT or sizes[1] > MAX_STARRED:
        return Rules()
    if any(name in patterns and name not in known for name in WHITE_LISTS):
        known = {name: pattern for name, pattern in known.items() if name not in WHITE_LISTS}
    return Rules(**known)
