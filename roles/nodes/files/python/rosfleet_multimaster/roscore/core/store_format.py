# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The lines of the store: the changes of one call are one line, with a checksum and a number.

    <checksum of the rest, 8 digits> <number> <JSON>

The first line is number 0 and a mapping: the format, and the boot of the computer that wrote it. A line counts if it is
whole, its checksum is right, and its number follows that of the line before. The first line that does not count ends the
file: a process or a computer that ends while it writes leaves half a line. Of a parameter, only the values that cannot be kept are left out.
"""

import base64
import json
import xmlrpc.client
import zlib
from typing import Any, Callable, Dict, Iterable, List, NamedTuple, Optional, Sequence, Tuple

from .bounds import Usage, check_names, refuse, weigh_parameter
from .registry import Record, Registry

FORMAT = 1
FILE = "registrations"  # the name of the store
SLACK, FACTOR = 1 << 20, 2  # a store is written anew when it has grown by so many bytes, and to so many times its size,
MOST = 1 << 26  # or by so many bytes. So many may wait for that at once


_SPECIAL = "\0special"  # XML has no such character, so no mapping of a parameter has this key
_SPARE = 1.1  # while it is read, things that are gone count for a while
_KINDS: Dict[str, Callable[[str], Any]] = {  # types that XML-RPC has and JSON lacks -> from the text that is kept
    "Binary": lambda text: xmlrpc.client.Binary(base64.b64decode(text)),
    "DateTime": xmlrpc.client.DateTime,
}
_UNKEPT = (ValueError, TypeError, OverflowError, RecursionError)
_NOTHING = object()


class Content(NamedTuple):
    """The content of a store."""

    registry: Registry
    boot: str
    size: int  # bytes that count,
    lines: int  # and the number of the last line in them
    torn: bool  # something follows that does not count,
    damaged: bool  # and it is more than one line that was not finished
    omissions: int  # lines or records that are whole, and could not be taken


def format_head(boot: str) -> bytes:
    """The first line."""
    return format_line(0, {"format": FORMAT, "boot": boot})


def format_line(number: int, content: Any) -> bytes:
    """One line. Raises ValueError, TypeError or RecursionError for a value that cannot be kept."""
    text = json.dumps(content, default=_to_json, separators=(",", ":"), ensure_ascii=False)
    data = f"{number} {text}".encode()
    return b"%08x %s\n" % (zlib.crc32(data), data)


def format_records(number: int, records: Sequence[Record]) -> bytes:
    """The line of one call's changes. Raises as `format_line`."""
    return format_line(number, [record.row for record in records])


def strip_values(records: Sequence[Record]) -> Tuple[List[Record], List[str]]:
    """The records without the values that cannot be kept, and the names of the parameters that have such values."""
    kept: List[Record] = []
    without: List[str] = []
    for record in records:
        if _is_kept(record.row):
            kept.append(record)
            continue
        if record.kind == "set":
            value = _strip_value(record.value)
            kept.append(Record("delete", record.name) if value is _NOTHING else record._replace(value=value))
        without.append(record.name)
    return kept, without


def _strip_value(value: Any) -> Any:
    """A value without the values that cannot be kept: of a mapping only the member goes, a list as a whole."""
    if isinstance(value, dict):
        parts = {key: _strip_value(part) for key, part in value.items() if isinstance(key, str) and _is_kept(key)}
        return {key: part for key, part in parts.items() if part is not _NOTHING}
    return value if _is_kept(value) else _NOTHING


def _is_kept(value: Any) -> bool:
    try:
        format_line(0, value)
    except _UNKEPT:
        return False
    return True


def read(lines: Iterable[bytes]) -> Optional[Content]:
    """Read a store, line by line; None if its first line is not one of this format.

    Lines after a damaged one do not count. Only a whole line is left out, if it makes no sense or exceeds a bound.
    """
    lines = iter(lines)
    head = next(lines, b"")
    first = _parse(head, 0)
    if not head.endswith(b"\n") or not isinstance(first, dict) or first.get("format") != FORMAT:
        return None
    registry, usage, size, last, omissions = Registry(), Usage(_SPARE), len(head), 0, 0
    rest = b""
    for number, text in enumerate(lines, 1):
        records = _parse(text, number)
        if records is None:
            rest = text
            break
        omissions += _apply(registry, usage, records)
        size, last = size + len(text), number
    more = rest.endswith(b"\n") or bool(rest) and next(lines, None) is not None
    return Content(registry, str(first.get("boot", "")), size, last, bool(rest), more, omissions)


def _apply(registry: Registry, usage: Usage, records: Any) -> int:
    """Carry out the records of a line; how many were left out."""
    if not isinstance(records, list):
        return 1
    omissions = 0
    for row in records:
        try:
            _apply_one(registry, usage, Record.from_row(row))
        except (ValueError, TypeError, LookupError):
            omissions += 1
    return omissions


def _apply_one(registry: Registry, usage: Usage, record: Record) -> None:
    """Carry out a record, within the bounds of a roscore. Raises ValueError."""
    kind, name = record.kind, record.name
    if kind == "set":
        usage.parameters += usage.growth(registry.parameters, name, record.value)
    elif kind == "delete":
        usage.parameters -= weigh_parameter(registry.parameters, name)
    else:
        check_names(record.texts, whole=True)
        if registry.is_known(record):
            return
        if record.is_there and usage.is_full(*record.texts):
            raise refuse("registrations", name)
        usage.count(record)
    registry.apply(record)


def _parse(text: bytes, number: int) -> Any:
    """The content of a line; None if it does not count, "" if it is whole and no JSON."""
    body = text[:-1]
    if not text.endswith(b"\n") or body[:9] != b"%08x " % zlib.crc32(body[9:]):
        return None
    written, _space, content = body[9:].partition(b" ")
    if written != b"%d" % number:
        return None
    try:
        return json.loads(content.decode(), object_hook=_from_json)
    except (ValueError, TypeError, RecursionError, MemoryError):
        return ""


def _to_json(value: Any) -> Any:
    kind = type(value).__name__
    if kind not in _KINDS:
        raise TypeError(f"a {kind} cannot be kept")
    return {_SPECIAL: [kind, base64.b64encode(value.data).decode() if kind == "Binary" else str(value.value)]}


def _from_json(mapping: Dict[str, Any]) -> Any:
    pair = mapping.get(_SPECIAL) if len(mapping) == 1 else None
    if not isinstance(pair, list) or len(pair) != 2 or pair[0] not in _KINDS or not isinstance(pair[1], str):
        return mapping
    return _KINDS[pair[0]](pair[1])


def is_renewal_due(size: int, base: int) -> bool:
    """True if a store of this size is written anew; `base`: its size when it was."""
    return size > base + SLACK and size > min(FACTOR * base, base + MOST)


def must_wait(size: int, base: int, waiting: int) -> bool:
    """True if a change has to wait for the new store: else the store, or the waiting changes, get too large."""
    return size > base + 3 * MOST or waiting > MOST
