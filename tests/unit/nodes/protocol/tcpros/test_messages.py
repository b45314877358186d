# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Messages cut out of a stream, however it comes."""

import struct

from hypothesis import given
from hypothesis import strategies as st
from rosfleet_multimaster.protocol.tcpros.messages import MessageReader


def message(body):
    return struct.pack("<I", len(body)) + body


@given(st.lists(st.binary(max_size=50), max_size=20), st.lists(st.integers(1, 60), min_size=1))
def test_messages_are_cut_wherever_the_bytes_are(bodies, sizes):
    reader, stream = MessageReader(40), b"".join(map(message, bodies))
    found, at, number = [], 0, 0
    while at < len(stream):
        size = sizes[number % len(sizes)]
        reader.feed(stream[at : at + size])
        found += iter(reader.take, None)
        at, number = at + size, number + 1
    assert found == [message(body) for body in bodies if len(body) <= 40]
    assert reader.skipped == sum(len(body) > 40 for body in bodies)


def test_a_length_of_4_gb_holds_nothing():
    reader = MessageReader(100)
    for data in (struct.pack("<I", 2**32 - 1), *[b"x" * 10000] * 100):
        reader.feed(data)
        assert reader.take() is None and reader.size == 0
    assert reader.skipped == 1


def test_a_longer_message_may_follow_a_short_one():
    """The bytes behind a header are read by the limit that is set after the header."""
    reader, large = MessageReader(10), message(bytes(1000))
    reader.feed(message(b"header") + large[:500])
    assert reader.take() == message(b"header")
    reader.most = 1000
    assert reader.take() is None
    reader.feed(large[500:] + b"\1")
    assert reader.take() == large and reader.rest() == b"\1" and reader.skipped == 0


@given(st.lists(st.binary(max_size=50), min_size=1, max_size=5), st.integers(0, 40))
def test_a_message_that_is_given_up_is_skipped_alone(bodies, count):
    reader, broken = MessageReader(100), message(bytes(60))
    reader.feed(broken[: 4 + count])
    assert reader.take() is None
    reader.give_up()
    assert reader.size == 0 and reader.skipped == 1
    reader.feed(broken[4 + count :] + b"".join(map(message, bodies)))
    assert list(iter(reader.take, None)) == [message(body) for body in bodies]
