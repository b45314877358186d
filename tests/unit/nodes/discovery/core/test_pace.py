# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
import pytest
from rosfleet_multimaster.discovery.core.pace import LIVELY, POLLS, QUICK, QUICK_POLLS, SAMPLES, SLOWEST, PollPace


def test_a_roscore_is_polled_as_often_as_it_is_cheap():
    polls = PollPace(0.08)
    assert polls.pause(100.0, 0.0005) == pytest.approx(0.0795)
    for number in range(SAMPLES):
        pause = polls.pause(100.0 + number, 0.008)
    assert pause == pytest.approx(0.008 * POLLS - 0.008)
    for number in range(SAMPLES):
        pause = polls.pause(110.0 + number, 2.0)
    assert pause == SLOWEST - 2.0


def test_one_poll_that_waited_for_a_processor_delays_nothing():
    polls = PollPace(0.08)
    polls.pause(100.0, 0.0005)
    assert polls.pause(100.1, 0.02) == pytest.approx(0.06)
    assert 0.0 < polls.pause(100.2, 0.3) <= QUICK, "nor is the next one without any pause"


def test_after_a_change_the_next_ones_are_awaited_for_a_while():
    polls = PollPace(0.08)
    assert polls.pause(100.0, 0.0005, changed=True) == pytest.approx(QUICK - 0.0005)
    assert polls.pause(100.0 + LIVELY / 2, 0.0005) == pytest.approx(QUICK - 0.0005)
    assert polls.pause(100.0 + LIVELY, 0.0005) == pytest.approx(0.0795)
    dear = PollPace(0.08)
    assert dear.pause(100.0, 0.1, changed=True) == pytest.approx(0.1 * QUICK_POLLS - 0.1)


def test_idle_polls_are_bounded_for_any_graph():
    """By what the asked and the asking side take together: an answer is waited for that long."""
    for cost in (0.0005, 0.0008, 0.002, 0.008, 0.04):
        polls, now, spent = PollPace(0.08), 100.0, 0.0
        while now < 200.0:
            spent, now = spent + cost, now + cost
            now += polls.pause(now, cost)
        assert spent / 100.0 < 0.0105
