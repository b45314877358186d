# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Waiting with a limit."""

import time

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._base import deadlines


def test_concurrently_keeps_the_order_and_leaves_the_late_behind():
    began = time.monotonic()
    results = deadlines.call_all(lambda item: time.sleep(item) or item, [0.2, 0, 60, 0.1], 2.0, lambda item: "late")
    assert results == [0.2, 0, "late", 0.1]
    assert time.monotonic() - began < 30


def test_concurrently_does_not_hide_a_mistake():
    with pytest.raises(ZeroDivisionError):
        deadlines.call_all(lambda item: 1 / item, [1, 0], 1, str)


def test_awaited_ends_as_soon_as_it_may_and_at_the_deadline():
    seen = iter([1, 2, 3])
    assert deadlines.poll(lambda: next(seen), lambda value: value == 2, time.monotonic() + 10) == 2
    assert deadlines.poll(lambda: "no", lambda value: False, time.monotonic()) == "no"
