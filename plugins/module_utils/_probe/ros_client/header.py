# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The header with which a connection of TCPROS begins (http://wiki.ros.org/ROS/Connection Header): fields to bytes, and back.

The modules have a copy (plugins/module_utils/_probe/ros_client/header.py; `make copies`), and their talker is a program whose
text has this file in it. So it runs on Python 3.6, and needs nothing.
"""

import struct
import typing

MOST_FIELDS = 100
#: a text keeps its bytes, whatever its encoding: a definition is copied, not read
KEEP = "surrogateescape"
_LENGTH = struct.Struct("<I")


class HeaderError(ValueError):
    """The bytes are no header; the text says why."""


def encode_block(content: bytes) -> bytes:
    """Return bytes with their length in front."""
    return _LENGTH.pack(len(content)) + content


def encode_header(fields: typing.Mapping[str, str]) -> bytes:
    """Return a header, its length in front."""
    return encode_block(b"".join(encode_block("=".join(field).encode("utf-8", KEEP)) for field in fields.items()))


def decode_header(frame: bytes, errors: str = KEEP) -> typing.Dict[str, str]:
    """Return the fields of a header, which has its length in front. As decode_fields."""
    return decode_fields(frame[_LENGTH.size :], errors)


def decode_fields(content: bytes, errors: str = KEEP) -> typing.Dict[str, str]:
    """Return the fields of a header, without its own length. `errors` as of bytes.decode. Raises HeaderError."""
    fields: typing.Dict[str, str] = {}
    at = 0
    while at < len(content):
        if at + _LENGTH.size > len(content):
            raise HeaderError("its last field has no length")
        (size,) = _LENGTH.unpack_from(content, at)
        at += _LENGTH.size
        name, equals, value = content[at : at + size].partition(b"=")
        if at + size > len(content) or not equals or len(fields) == MOST_FIELDS:
            raise HeaderError("a field is longer than the header, has no name, or is one too many")
        fields[name.decode("utf-8", errors)] = value.decode("utf-8", errors)
        at += size
    return fields
