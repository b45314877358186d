# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The throttle: a robot has no more of a processor than its share in the long run, and a robot that takes little never waits."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rosfleet_multimaster.edge.core.efforts import MOST
from rosfleet_multimaster.edge.process import throttle

SHARE, TOGETHER, BURST, PATIENCE = 0.2, 0.5, 1.0, 5.0


@pytest.fixture
def clock(monkeypatch):
    return make_clock(monkeypatch)


def make_clock(monkeypatch):
    now = [0.0]

    def sleep(seconds):
        now[0] += max(seconds, 1e-6)

    monkeypatch.setattr(throttle, "monotonic", lambda: now[0])
    monkeypatch.setattr(throttle, "sleep", sleep)
    return now


def make():
    return throttle.Throttle(SHARE, TOGETHER, BURST, PATIENCE)


@settings(max_examples=30, deadline=None)
@given(st.lists(st.floats(0.001, 1.0), min_size=20, max_size=60))
def test_one_caller_has_its_share(efforts):
    with pytest.MonkeyPatch.context() as patch:
        now, made, spent = make_clock(patch), make(), 0.0
        for effort in efforts:
            if made.wait("robot2"):
                made.spend("robot2", effort)
                now[0] += effort
                spent += effort
            assert spent <= BURST + SHARE * now[0] + max(efforts) + 1e-6


def test_all_together_have_theirs(clock):
    made, spent, callers = make(), 0.0, [f"robot{number}" for number in range(20)]
    for _round in range(50):
        for caller in callers:
            if made.wait(caller):
                made.spend(caller, 0.1)
                spent += 0.1
    assert spent <= len(callers) * (BURST + 0.1) + TOGETHER * clock[0]


def test_who_has_taken_little_never_waits(clock):
    made = make()
    for _count in range(100):
        made.spend("hostile", 1.0)
        before = clock[0]
        assert made.wait("friend") and clock[0] == before
        made.spend("friend", 0.01)
        clock[0] += 0.2
    assert not made.wait("hostile") and clock[0] >= before + PATIENCE


def test_what_was_taken_is_paid_back_and_forgotten(clock):
    made = make()
    made.spend("robot2", BURST + 0.5)
    assert made.wait("robot2") and clock[0] == pytest.approx(2.5, abs=0.1)
    clock[0] += 100.0
    assert made.wait("robot2") and not len(made.efforts)


@pytest.mark.slow
def test_callers_without_end_share_one_account(clock):
    made = make()
    for number in range(10_000):
        made.spend(f"10.0.{number >> 8}.{number & 255}", 0.01)
    assert len(made.efforts) <= MOST + 1
    assert not made.wait("10.9.9.9") and made.wait("10.0.0.1")
