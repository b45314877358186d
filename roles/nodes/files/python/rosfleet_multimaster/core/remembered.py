# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The lines of the store: what one call changed is one line, with a checksum and a number.

    <checksum of the rest, 8 digits> <number> <JSON>

The first line is number 0 and a mapping: the format, and the boot of the computer that wrote it. A line counts if it is
whole, its checksum is right, and its number follows that of the line before. The first line that does not count ends the
file: a process or a computer that ended while it wrote leaves half a line.
"""

import base64
import json
import zlib
from typing import Any, Dict, List, NamedTuple, Optional, Sequence

from .registry import Record, Registry

FORMAT = 1
FILE = "registrations"  # the name of the store
SLACK, FACTOR = 1 << 20, 2  # a store is written anew when it has grown by so many bytes, and to so many times its size


class Special(NamedTuple):
    """A value that XML-RPC has and JSON has not: the name of its class in xmlrpc.client, and its text."""

    kind: str
    text: str

    @classmethod
    def of(cls, value: Any) -> "Special":
        """The value of a parameter. Raises TypeError where it is none."""
        kind = type(value).__name__
        if kind == "Binary":
            return cls(kind, base64.b64encode(value.data).decode())
        if kind == "DateTime":
            return cls(kind, str(value.value))
        raise TypeError(f"a {kind} cannot be kept")

    def content(self) -> Any:
        """The text or bytes that the class is made of again."""
        return base64.b64decode(self.text) if self.kind == "Binary" else self.text


_SPECIAL = "\0special"  # XML has no such character, so no mapping of a parameter has this key


class Remembered(NamedTuple):
    """The content of a store."""

    registry: Registry
    boot: str
    good: int  # bytes that count,
    lines: int  # and the number of the last line in them
    torn: bool  # something follows that does not count,
    damaged: bool  # and it is more than one line that was not finished


def head(boot: str) -> bytes:
    """The first line."""
    return line(0, {"format": FORMAT, "boot": boot})


def line(number: int, content: Any) -> bytes:
    """One line. Raises ValueError or TypeError for a value that cannot be kept."""
    text = f"{number} {json.dumps(content, default=_plain, separators=(',', ':'))}".encode()
    return b"%08x %s\n" % (zlib.crc32(text), text)


def read(data: bytes, special: Any = lambda value: value) -> Optional[Remembered]:
    """Read a store; None where it is none, or of another format. `special` makes values of Special ones."""
    lines = data.split(b"\n")
    first = _content(lines[0], 0, special)
    if len(lines) < 2 or not isinstance(first, dict) or first.get("format") != FORMAT:
        return None
    registry, good, last = Registry(), len(lines[0]) + 1, 0
    for number, text in enumerate(lines[1:-1], 1):
        records = _content(text, number, special)
        if not isinstance(records, list) or not _applied(registry, records):
            break
        good, last = good + len(text) + 1, number
    rest = data[good:]
    return Remembered(registry, str(first.get("boot", "")), good, last, bool(rest), b"\n" in rest)


def _applied(registry: Registry, records: Sequence[Record]) -> bool:
    try:
        for record in records:
            registry.apply(record)
    except ValueError:
        return False
    return True


def _content(text: bytes, number: int, special: Any) -> Any:
    """The content of a line; None where it does not count."""
    try:
        if text[:9] != b"%08x " % zlib.crc32(text[9:]):
            return None
        written, _space, body = text[9:].partition(b" ")
        if int(written) != number:
            return None
        return json.loads(body.decode(), object_hook=lambda found: _revived(found, special))
    except ValueError:
        return None


def _plain(value: Any) -> Any:
    return {_SPECIAL: list(Special.of(value))}


def _revived(found: Dict[str, Any], special: Any) -> Any:
    given: List[Any] = found.get(_SPECIAL, [])
    return special(Special(*given)) if given else found


def grown(size: int, base: int) -> bool:
    """True where a store of this size is written anew; `base`: its size when it was."""
    return size > base + SLACK and size > FACTOR * base
