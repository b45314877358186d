# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
import pytest
from rosfleet_multimaster.sync.core.pace import BURST, Pace


def test_whoever_streams_changes_has_so_many_a_second():
    """An answer comes at once, whatever is asked; each one has news."""
    for whole, most in ((False, BURST + 10 * 20.0), (True, 1 + 10 * 1.0 + 1)):
        pace, now, answers = Pace(), 100.0, 0
        while now < 110.0:
            now = pace.next(now, 0.0, whole, False) + 0.0001
            answers += 1
        assert answers <= most + 1


def test_costly_masters_are_asked_less():
    assert Pace().next(100.0, 0.5, False, False) == 102.0
    assert Pace().next(100.0, 0.0, False, True) == 101.0
    assert Pace().next(100.0, 0.001, False, False) == pytest.approx(100.004)
