# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The messages that helpers send each other."""

import struct

from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.multicast import messages as m
from hypothesis import given
from hypothesis import strategies as st


@given(st.binary(max_size=200))
def test_arbitrary_bytes_are_refused(data):
    assert m.decode(data, "run") is None


@given(st.integers(1, 3), st.booleans(), st.integers(0, 2**32 - 1), st.floats(0, 4e9))
def test_a_message_comes_back_and_only_to_its_own_run(kind, done, number, time):
    message = m.Message(kind, done, "192.168.1.229", number, number, number, "10.0.0.1", time, time + 1)
    data = m.encode(message, "morning")
    assert m.decode(data, "morning") == message
    assert m.decode(data, "evening") is None
    flipped = bytes([data[0] ^ 1]) + data[1:]
    assert m.decode(flipped, "morning") is None


def test_an_answer_is_not_larger_than_its_question():
    sizes = {len(m.encode(m.Message(kind, False, "10.0.0.1"), "run")) for kind in (m.HELLO, m.ASK, m.ANSWER)}
    assert sizes == {60}


def test_the_message_has_the_documented_layout():
    body = m.encode(m.Message(m.ANSWER, True, "10.0.0.1", 1, 2, 3, "10.0.0.2", 1.5, 2.5), "run")[16:]
    assert struct.unpack("!4sBB2x4sIII4sdd", body) == (
        b"RFMV", 3, 1, bytes([10, 0, 0, 1]), 1, 2, 3, bytes([10, 0, 0, 2]), 1.5, 2.5,
    )  # fmt: skip
