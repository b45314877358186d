# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The memory of a relay: who pays where all hold too much."""

from hypothesis import given
from hypothesis import strategies as st
from rosfleet_multimaster.relay.core.budget import KEPT, LATCHED, Budget
from rosfleet_multimaster.relay.core.outbox import QUEUE, Outbox


class Payer:
    """A connection with an outbox."""

    def __init__(self, budget, progress=0.0, robot=""):
        self.outbox, self.progress, self.budget = Outbox(budget), progress, budget
        self.robot = robot or f"robot{len(budget.payers)}"
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


def test_many_connections_of_one_robot_pay_as_one():
    budget = Budget(1000)
    many, one = [Payer(budget, robot="many") for _number in range(9)], Payer(budget)
    for payer in many:
        payer.outbox.add(bytes(100))
    one.outbox.add(bytes(300))
    assert one.outbox.dropped == 0 and sum(payer.outbox.dropped for payer in many) == 4  # until there is some room


ROBOTS = ("own", "bad", "good", "")


def test_what_is_kept_for_who_comes_later_is_bounded_by_robot():
    budget, part = Budget(robots=ROBOTS, own="own"), bytes(8 << 20)
    count = next(number for number in range(100) if not budget.latch("bad", None, part))
    assert count * len(part) == LATCHED[1], "of one robot"
    assert budget.latch("good", None, part), "and each has a share"
    assert not budget.latch("bad", part, bytes(9 << 20)) and budget.latch("bad", None, part), (
        "so that one has none any more"
    )
    assert budget.latch("bad", part, None) and budget.latch("bad", None, part)


@given(st.lists(st.tuples(st.sampled_from(ROBOTS), st.integers(1, 1 << 20)), max_size=200))
def test_what_stays_is_bounded_and_given_back(deeds):
    budget, had = Budget(robots=ROBOTS, own="own"), []
    for robot, size in deeds:
        if budget.keep(robot, size):
            had.append((robot, size))
    assert sum(size for _robot, size in had) <= KEPT[0]
    assert all(sum(size for robot, size in had if robot == one) <= KEPT[1] for one in ROBOTS if one != "own")
    for robot, size in had:
        assert budget.keep(robot, -size)
    assert budget.keep("bad", KEPT[1]) and budget.keep("good", KEPT[0] // 12)


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
