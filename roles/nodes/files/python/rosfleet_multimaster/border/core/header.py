# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The header with which a connection of TCPROS begins (wiki.ros.org/ROS/Connection Header): fields to bytes, and back.

Texts keep their bytes, whatever their encoding: a definition is copied, not read.
"""

import struct
from typing import Dict, Mapping

MAX_HEADER = 1 << 18  # bytes; the definition of the messages is in it
MOST_FIELDS = 100
_SIZE = struct.Struct("<I")
_TEXT = 80  # bytes of a text without its letters, at most


class HeaderError(ValueError):
    """The bytes are no header; the text says why."""


def encode_header(fields: Mapping[str, str]) -> bytes:
    """Return a header, its length in front."""
    parts = [f"{name}={value}".encode("utf-8", "surrogateescape") for name, value in fields.items()]
    body = b"".join(_SIZE.pack(len(part)) + part for part in parts)
    return _SIZE.pack(len(body)) + body


def decode_header(frame: bytes) -> Dict[str, str]:
    """Return the fields of a header, which has its length in front. Raises HeaderError."""
    fields: Dict[str, str] = {}
    at = _SIZE.size
    while at < len(frame):
        if at + _SIZE.size > len(frame):
            raise HeaderError("its last field has no length")
        (size,) = _SIZE.unpack_from(frame, at)
        at += _SIZE.size
        name, equals, value = frame[at : at + size].partition(b"=")
        if at + size > len(frame) or not equals or len(fields) == MOST_FIELDS:
            raise HeaderError("a field is longer than the header, has no name, or is one too many")
        fields[name.decode("utf-8", "surrogateescape")] = value.decode("utf-8", "surrogateescape")
        at += size
    return fields


def weigh_fields(fields: Mapping[str, str]) -> int:
    """Return the bytes of memory of the fields of a header, at most: a letter has one in a text of ASCII, else up to four (PEP 393)."""
    return sum(_TEXT + len(text) * (1 if text.isascii() else 4) for item in fields.items() for text in item)
