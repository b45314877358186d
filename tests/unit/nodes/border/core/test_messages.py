# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Messages cut out of a stream, however it comes."""

import struct

from hypothesis import given
from hypothesis import strategies as st
from rosfleet_multimaster.border.core.messages import MessageReader


def message(body):
    return struct.pack("<I", len(body)) + body


@given(st.lists(st.binary(max_size=50), max_size=20), st.lists(st.integers(1, 60), min_size=1))
def test_messages_are_cut_wherever_the_bytes_are(bodies, sizes):
    reader, stream = MessageReader(40), b"".join(map(message, bodies))
    found, at, number = [], 0, 0
    while at < len(stream):
        size = sizes[number % len(sizes)]
        found += reader.feed(stream[at : at + size])
        at, number = at + size, number + 1
    assert found == [message(body) for body in bodies if len(body) <= 40]
    assert reader.skipped == sum(len(body) > 40 for body in bodies)


def test_a_length_of_4_gb_holds_nothing():
    reader = MessageReader(100)
    assert reader.feed(struct.pack("<I", 2**32 - 1)) == []
    for _number in range(100):
        assert reader.feed(b"x" * 10000) == []
    assert reader.skipped == 1 and not reader._held
