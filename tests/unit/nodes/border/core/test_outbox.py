# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Messages that wait for a connection: bounds, the newest, and rates."""

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rosfleet_multimaster.border.core.messages import MessageReader
from rosfleet_multimaster.border.core.outbox import QUEUE, Budget, Outbox, Throttle


def message(body):
    return struct.pack("<I", len(body)) + body


@given(st.lists(st.one_of(st.binary(min_size=1, max_size=30), st.none()), max_size=60))
def test_what_is_dropped_and_what_leaves_is_all(deeds):
    box, put, left = Outbox(Budget()), 0, []
    box._most, box._limit = 5, 60
    for deed in deeds:
        if deed is None:
            left.append(box.take())
        else:
            box.add(message(deed))
            put += 1
        assert len(box) <= 5 and (box.size <= 60 or len(box) == 1)
    left.append(box.take())
    while len(box):
        left.append(box.take())
    assert len(MessageReader(100).feed(b"".join(left))) + box.dropped == put and box.size == 0


def test_only_the_newest_waits():
    box = Outbox(Budget(), newest=True)
    for number in range(10):
        box.add(message(bytes([number])))
    assert box.take() == message(b"\x09") and box.take() == b"" and box.dropped == 9


def test_the_fullest_pays_for_all():
    budget = Budget(1000)
    small, large = Outbox(budget), Outbox(budget)
    small.add(bytes(10))
    for _number in range(QUEUE[0]):
        large.add(bytes(100))
    assert small.size == 10 and large.size <= 1000 and large.dropped > 80
    large.close()
    small.add(bytes(900))
    assert small.dropped == 0


def test_a_throttle_lets_the_newest_follow():
    throttle = Throttle(5.0)
    assert throttle.pass_on(b"1", 10.0)
    assert not throttle.pass_on(b"2", 10.05) and not throttle.pass_on(b"3", 10.1)
    assert throttle.due == pytest.approx(10.2) and throttle.release(10.1) is None
    assert throttle.release(10.21) == b"3" and throttle.dropped == 1 and throttle.due is None
    assert not throttle.pass_on(b"4", 10.3)
    assert Throttle(0.0).pass_on(b"1", 1.0)


@given(st.floats(1.0, 50.0), st.lists(st.floats(0.001, 0.3), min_size=20, max_size=100))
def test_a_throttle_keeps_its_rate(rate, pauses):
    throttle, now, passed = Throttle(rate), 100.0, []
    for pause in pauses:
        now += pause
        if throttle.release(now):
            passed.append(now)
        if throttle.pass_on(b"x", now):
            passed.append(now)
    assert all(late - early >= 1 / rate - 1e-6 for early, late in zip(passed, passed[1:]))
