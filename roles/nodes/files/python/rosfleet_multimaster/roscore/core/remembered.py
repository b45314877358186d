# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The lines of the store: what one call changed is one line, with a checksum and a number.

    <checksum of the rest, 8 digits> <number> <JSON>

The first line is number 0 and a mapping: the format, and the boot of the computer that wrote it. A line counts if it is
whole, its checksum is right, and its number follows that of the line before. The first line that does not count ends the
file: a process or a computer that ended while it wrote leaves half a line. A value that JSON has not is left out alone.
"""

import base64
import json
import zlib
from typing import Any, Dict, Iterable, List, NamedTuple, Optional, Sequence, Tuple

from .bounds import Room, beyond, freed, names
from .registry import Record, Registry

FORMAT = 1
FILE = "registrations"  # the name of the store
SLACK, FACTOR = 1 << 20, 2  # a store is written anew when it has grown by so many bytes, and to so many times its size,
MOST = 1 << 26  # or by so many bytes; so many may wait for that at once


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
_SPARE = 1.1  # while it is read, what is gone counts as well for a while
_KINDS = ("Binary", "DateTime")
_UNKEPT = (ValueError, TypeError, OverflowError, RecursionError)
_NOTHING = object()


class Remembered(NamedTuple):
    """The content of a store."""

    registry: Registry
    boot: str
    good: int  # bytes that count,
    lines: int  # and the number of the last line in them
    torn: bool  # something follows that does not count,
    damaged: bool  # and it is more than one line that was not finished
    left_out: int  # lines or records that are whole, and could not be taken


def head(boot: str) -> bytes:
    """The first line."""
    return line(0, {"format": FORMAT, "boot": boot})


def line(number: int, content: Any) -> bytes:
    """One line. Raises ValueError, TypeError or RecursionError for a value that cannot be kept."""
    text = json.dumps(content, default=_plain, separators=(",", ":"), ensure_ascii=False)
    data = f"{number} {text}".encode()
    return b"%08x %s\n" % (zlib.crc32(data), data)


def keepable(records: Sequence[Record]) -> Tuple[List[Record], List[str]]:
    """The same records without the values that cannot be kept, and the names of the parameters that have them."""
    kept: List[Record] = []
    without: List[str] = []
    for record in records:
        try:
            line(0, [record])
            kept.append(record)
        except _UNKEPT:
            if record[0] == "set":
                value = _kept_of(record[2])
                kept.append(["delete", record[1]] if value is _NOTHING else ["set", record[1], value])
            without.append(str(record[1]))
    return kept, without


def _kept_of(value: Any) -> Any:
    """A value without what cannot be kept: a member of a mapping goes alone, a list as a whole."""
    if isinstance(value, dict):
        parts = {key: _kept_of(part) for key, part in value.items() if isinstance(key, str) and _is_kept(key)}
        return {key: part for key, part in parts.items() if part is not _NOTHING}
    return value if _is_kept(value) else _NOTHING


def _is_kept(value: Any) -> bool:
    try:
        line(0, value)
    except _UNKEPT:
        return False
    return True


def read(lines: Iterable[bytes], special: Any = lambda value: value) -> Optional[Remembered]:
    """Read a store, line by line; None where it is none, or of another format. `special` makes values of Special ones.

    What follows a line that is damaged does not count. A line that is whole, but says what nobody understands or what is
    more than is taken, is left out alone.
    """
    given = iter(lines)
    head = next(given, b"")
    first = _content(head, 0, special)
    if not head.endswith(b"\n") or not isinstance(first, dict) or first.get("format") != FORMAT:
        return None
    registry, room, good, last, left_out = Registry(), Room(_SPARE), len(head), 0, 0
    rest = b""
    for number, text in enumerate(given, 1):
        records = _content(text, number, special)
        if records is None:
            rest = text
            break
        left_out += _apply(registry, room, records)
        good, last = good + len(text), number
    more = rest.endswith(b"\n") or bool(rest) and next(given, None) is not None
    return Remembered(registry, str(first.get("boot", "")), good, last, bool(rest), more, left_out)


def _apply(registry: Registry, room: Room, records: Any) -> int:
    """Carry out the records of a line; how many were left out."""
    if not isinstance(records, list):
        return 1
    left_out = 0
    for record in records:
        try:
            _apply_one(registry, room, record)
        except (ValueError, TypeError, LookupError):
            left_out += 1
    return left_out


def _apply_one(registry: Registry, room: Room, record: Record) -> None:
    """Carry out a record, within the bounds of a roscore. Raises ValueError."""
    registry.check(record)
    kind, name = record[:2]
    if kind == "set":
        room.parameters += room.set(registry.parameters, name, record[2])
    elif kind == "delete":
        room.parameters -= freed(registry.parameters, name)
    else:
        names(record[1:], whole=True)
        if record == registry.now(record):
            return
        if record[-1] and room.is_full(*[part for part in record[1:] if isinstance(part, str)]):
            raise beyond("registrations", name)
        room.count(record)
    registry.apply(record)


def _content(text: bytes, number: int, special: Any) -> Any:
    """The content of a line; None where it does not count, and "" where it is whole and cannot be understood."""
    body = text[:-1]
    if not text.endswith(b"\n") or body[:9] != b"%08x " % zlib.crc32(body[9:]):
        return None
    written, _space, content = body[9:].partition(b" ")
    if written != b"%d" % number:
        return None
    try:
        return json.loads(content.decode(), object_hook=lambda found: _revived(found, special))
    except (ValueError, TypeError, RecursionError, MemoryError):
        return ""


def _plain(value: Any) -> Any:
    return {_SPECIAL: list(Special.of(value))}


def _revived(found: Dict[str, Any], special: Any) -> Any:
    given = found.get(_SPECIAL) if len(found) == 1 else None
    if not isinstance(given, list) or len(given) != 2 or given[0] not in _KINDS or not isinstance(given[1], str):
        return found
    return special(Special(*given))


def grown(size: int, base: int) -> bool:
    """True where a store of this size is written anew; `base`: its size when it was."""
    return size > base + SLACK and size > min(FACTOR * base, base + MOST)


def behind(size: int, base: int, waiting: int) -> bool:
    """True where whoever changes something has to wait until the store is written anew: else it, or what waits, gets too large."""
    return size > base + 3 * MOST or waiting > MOST
