# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""A value that is kept for a moment is read again after it, and after a failure at once."""

import pytest
from rosfleet_multimaster.edge import clock


def test_a_value_is_kept_for_a_moment(monkeypatch):
    answers = iter([1, OSError(), 2, 3])
    now = 100.0
    monkeypatch.setattr(clock, "monotonic", lambda: now)

    def read():
        answer = next(answers)
        if isinstance(answer, Exception):
            raise answer
        return answer

    value = clock.keep_fresh(read)
    assert [value(), value()] == [1, 1]
    now += clock.FRESH
    with pytest.raises(OSError):
        value()
    assert [value(), value()] == [2, 2], "a failure is not kept"
    now += clock.FRESH
    assert value() == 3
