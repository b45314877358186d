# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The header of a connection: any fields, any bytes."""

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rosfleet_multimaster.protocol.tcpros.header import (
    MOST_FIELDS,
    HeaderError,
    decode_fields,
    decode_header,
    encode_header,
)

FIELDS = st.dictionaries(st.text("abc_", min_size=1), st.text(), max_size=10)


def message(body):
    return struct.pack("<I", len(body)) + body


@given(FIELDS)
def test_a_header_is_what_it_was(fields):
    assert decode_header(encode_header(fields)) == fields


def test_a_value_keeps_its_bytes():
    part = b"message_definition=\xff\xfe = \n"
    frame = message(struct.pack("<I", len(part)) + part)
    assert encode_header(decode_header(frame)) == frame


def test_a_value_can_be_read_as_text_that_every_program_takes():
    assert decode_fields(struct.pack("<I", 3) + b"a=\xff", "replace") == {"a": "\ufffd"}


@given(st.binary(max_size=200))
def test_any_bytes_are_a_header_or_a_header_error(body):
    try:
        decode_header(message(body))
    except HeaderError:
        pass


def test_too_many_fields_are_no_header():
    with pytest.raises(HeaderError):
        decode_header(encode_header({str(number): "x" for number in range(MOST_FIELDS + 1)}))
