# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The share of a robot: what it may take in one turn, and in the long run."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rosfleet_multimaster.relay.core.effort import BURST, SAID, SHARE, Effort, make_efforts


@given(st.lists(st.floats(0.0001, 0.04), min_size=50, max_size=200))
def test_who_waits_as_told_takes_its_share_and_no_more(costs):
    effort, now, turn, spent, in_turn = Effort("robot2", make_efforts("robot1")), 100.0, 1, 0.0, 0.0
    for cost in costs:
        while True:
            wait = effort.find_wait(now, turn)
            if wait is None:
                break
            now, turn, in_turn = now + wait + 1e-9, turn + 1, 0.0
        assert in_turn < BURST
        now, spent, in_turn = now + cost, spent + cost, in_turn + cost
        effort.spend(cost, now, turn)
    assert spent <= SHARE * (now - 100.0) + BURST + 0.04 + 1e-6


def test_who_takes_little_never_waits():
    effort = Effort("robot2", make_efforts("robot1"))
    for turn in range(1000):
        now = turn / 1000
        assert effort.find_wait(now, turn) is None
        effort.spend(0.4 / 1000, now, turn)
    assert not effort.is_slowed(1.0)


def test_who_waits_is_told_for_a_while():
    effort = Effort("robot2", make_efforts("robot1"))
    effort.spend(1.0, 50.0, 1)
    assert effort.find_wait(50.0, 2) == pytest.approx((1.0 - BURST) / SHARE)
    assert effort.is_slowed(50.0 + SAID / 2) and not effort.is_slowed(50.0 + SAID)
