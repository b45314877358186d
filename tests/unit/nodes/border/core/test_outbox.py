# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Messages that wait for a connection: bounds, the newest, and rates."""

import struct

from hypothesis import given
from hypothesis import strategies as st
from rosfleet_multimaster.border.core.messages import MessageReader
from rosfleet_multimaster.border.core.outbox import LATCHED, QUEUE, Budget, Outbox


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


class Payer:
    """A connection with an outbox."""

    def __init__(self, budget, progress=0.0, address=""):
        self.outbox, self.progress, self.budget = Outbox(budget), progress, budget
        self.address = address or f"10.0.0.{len(budget.payers)}"
        self.shrink = self.outbox.drop_all
        budget.payers.add(self)

    @property
    def size(self):
        return self.outbox.size

    @property
    def is_sending(self):
        return self.outbox.is_sending

    @property
    def is_stuck(self):
        return self.outbox.is_sending and self.progress < 0

    def end(self, why):
        self.outbox.close()
        self.budget.payers.discard(self)


def test_the_fullest_pays_for_all():
    budget = Budget(1000)
    small, large = Payer(budget), Payer(budget)
    small.outbox.add(bytes(10))
    for _number in range(QUEUE[0]):
        large.outbox.add(bytes(100))
    assert small.size == 10 and large.size <= 1000 and large.outbox.dropped > 80
    large.outbox.close()
    small.outbox.add(bytes(900))
    assert small.outbox.dropped == 0


def test_many_connections_of_one_computer_pay_as_one():
    budget = Budget(1000)
    many, one = [Payer(budget, address="10.9.9.9") for _number in range(9)], Payer(budget)
    for payer in many:
        payer.outbox.add(bytes(100))
    one.outbox.add(bytes(300))
    assert one.outbox.dropped == 0 and sum(payer.outbox.dropped for payer in many) == 2


def test_what_is_kept_for_who_comes_later_is_bounded():
    budget, third = Budget(), bytes(LATCHED // 3)
    assert all(budget.latch(None, third) for _publisher in range(3))
    assert not budget.latch(None, third) and not budget.latch(
        third, bytes(LATCHED)
    )  # so the last one has none any more
    assert budget.latch(None, third) and not budget.latch(None, third)
    assert budget.latch(third, None) and budget.latch(None, third)


def test_who_reads_nothing_for_longest_ends_at_last():
    budget = Budget(1000)
    payers = [Payer(budget, progress) for progress in (5.0, 1.0, 3.0)]
    for payer in payers:
        payer.outbox.add(bytes(300))
        payer.outbox.find_due()
    budget.change(200)
    assert [payer in budget.payers for payer in payers] == [True, False, True] and budget.used == 800


def test_those_that_are_stuck_end_before_others_lose_anything():
    budget = Budget(1000)
    stuck, awake = [Payer(budget, -1.0) for _number in range(2)], Payer(budget)
    for payer in stuck:
        payer.outbox.add(bytes(450))
        payer.outbox.find_due()
    awake.outbox.add(bytes(300))
    assert not awake.outbox.dropped and [payer in budget.payers for payer in stuck].count(True) == 1


def test_a_message_counts_once_for_all_that_listen():
    budget = Budget(1000)
    payers = [Payer(budget) for _number in range(50)]
    for _number in range(5):
        common = bytes(190)
        for payer in payers:
            payer.outbox.add(common)
            payer.outbox.find_due()  # being sent, to somebody who does not read
    assert budget.used == 950 and not any(payer.outbox.dropped for payer in payers)
    for payer in payers:
        payer.outbox.close()
    assert budget.used == 0


@given(st.lists(st.tuples(st.integers(0, 5), st.integers(1, 400), st.booleans()), max_size=80))
def test_no_more_is_held_than_the_budget_has(deeds):
    budget = Budget(1000)
    payers = [Payer(budget) for _number in range(6)]
    for number, size, sending in deeds:
        if payers[number] in budget.payers:
            payers[number].outbox.add(bytes(size))
        if sending and payers[number] in budget.payers:
            payers[number].outbox.find_due()
        assert budget.used == sum(len(message) for message, _count in budget._held.values()) <= 1000
