# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Messages that wait for a connection: bounds, the newest, and rates."""

import struct

from hypothesis import given
from hypothesis import strategies as st
from rosfleet_multimaster.protocol.tcpros.messages import MessageReader
from rosfleet_multimaster.relay.core.budget import Budget
from rosfleet_multimaster.relay.core.outbox import Outbox


def message(body):
    return struct.pack("<I", len(body)) + body


def leave(box, most=1 << 20):
    """Send one step, of so many bytes at most; return the bytes."""
    data = bytes(box.find_due()[:most])
    box.count_sent(len(data))
    return data


@given(st.lists(st.one_of(st.binary(min_size=1, max_size=30), st.integers(1, 100)), max_size=60))
def test_what_is_dropped_and_what_leaves_is_all(deeds):
    budget = Budget()
    box, put, left = Outbox(budget), 0, []
    box._most, box._limit = 5, 60
    for deed in deeds:
        if isinstance(deed, int):
            left.append(leave(box, deed))
        else:
            box.add(message(deed))
            put += 1
        assert len(box) <= 5 and (box.size <= 60 or len(box) == 1)
    while len(box) or box.is_sending:
        left.append(leave(box))
    reader = MessageReader(100)
    reader.feed(b"".join(left))
    assert len(list(iter(reader.take, None))) + box.dropped == put and box.size == budget.used == 0 and not budget._held


def test_a_header_leaves_before_all_that_waits():
    box = Outbox(Budget())
    box.add(message(b"first"))
    assert leave(box, 3) == message(b"first")[:3]
    box.add(message(b"second"))
    box.say(b"header")
    assert leave(box) == message(b"first")[3:] + b"header" and leave(box) == message(b"second")


def test_only_the_newest_waits():
    box = Outbox(Budget(), newest=True)
    for number in range(10):
        box.add(message(bytes([number])))
    assert leave(box) == message(b"\x09") and leave(box) == b"" and box.dropped == 9
