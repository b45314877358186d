# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The values of parameters that cross: the accepted ones of another robot, and the digest by which two are compared.

The other robot may send anything. A value is taken as it can be written again: of the plain types of XML-RPC, in bounds.
"""

import hashlib
import json
import math
import re
from typing import Any, Dict, List, Tuple

from ...protocol.json_text import UNWRITABLE

DEPTH = 16  # lists and mappings in each other
PARTS = 20_000  # texts, numbers and the like in one value
BYTES = 1 << 20  # of the texts of one value, in UTF-8
KEY = 255  # characters of the name of a member
_PART = 16  # bytes that a number, or the frame of anything, counts
_INTEGERS = range(-(1 << 31), 1 << 31)  # XML-RPC has no others
_LINE_END = re.compile("\r\n?")
_NO_KEY = re.compile("[/\0-\x1f\x7f]")


class UnusableValue(ValueError):
    """A value that is not taken; its text goes on after "its value"."""


class _ValueReader:
    """Makes one value anew, and counts its bytes."""

    def __init__(self) -> None:
        self.parts = self.size = 0

    def take(self, value: Any, depth: int = 0) -> Any:
        """The value. Raises UnusableValue."""
        self._count(1, _PART)
        if isinstance(value, (dict, list, tuple)):
            if depth >= DEPTH:
                raise UnusableValue(f"has more than {DEPTH} lists and mappings in each other")
            return self._members(value, depth) if isinstance(value, dict) else self._items(list(value), depth)
        if isinstance(value, str):
            return self._text(value)
        if isinstance(value, bytes):
            self._count(0, len(value))
            return value
        return _take_number(value)

    def _items(self, value: List[Any], depth: int) -> List[Any]:
        return [self.take(item, depth + 1) for item in value]

    def _members(self, value: Dict[Any, Any], depth: int) -> Dict[str, Any]:
        for key in value:
            if not isinstance(key, str) or not 0 < len(key) <= KEY or _NO_KEY.search(key):
                raise UnusableValue("has a member whose name is no short text without a slash")
        return {self._text(key): self.take(part, depth + 1) for key, part in value.items()}

    def _text(self, text: str) -> str:
        if UNWRITABLE.search(text):
            raise UnusableValue("has a character that XML does not have")
        self._count(0, len(text) if text.isascii() else len(text.encode()))
        return _LINE_END.sub("\n", text)  # as whoever reads it from XML has it

    def _count(self, parts: int, size: int) -> None:
        self.parts, self.size = self.parts + parts, self.size + size
        if self.parts > PARTS:
            raise UnusableValue(f"has more than {PARTS} parts")
        if self.size > BYTES:
            raise UnusableValue(f"has more than {BYTES} bytes")


def _take_number(value: Any) -> Any:
    if isinstance(value, int) and value in _INTEGERS:  # true and false, too
        return value
    if isinstance(value, float) and math.isfinite(value):
        return value
    if isinstance(value, (int, float)):
        raise UnusableValue("has a number that XML-RPC does not have")
    raise UnusableValue("is no text, number, list or mapping, and has nothing but these in it")


def take(value: Any) -> Tuple[Any, int]:
    """A value of another robot, made anew, and its size in bytes. Raises UnusableValue."""
    reader = _ValueReader()
    return reader.take(value), reader.size


def digest(value: Any) -> str:
    """The common form of two values that are the same, also in their types."""
    try:
        text = json.dumps(value, sort_keys=True, default=lambda other: [type(other).__name__, repr(other)])
    except (ValueError, TypeError, RecursionError):  # an own value, which may be anything: it is not one of ours
        text = "?"
    return hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()
