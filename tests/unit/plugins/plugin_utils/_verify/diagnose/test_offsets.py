# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""By how much a clock is off, and from whose."""

import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.checks.engine import FAILED, Row
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.components.component import Component
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.diagnose.offsets import offset

CLOCK = Component("clock", "a", "off")


def row(observer, target, found, check="clock"):
    return Row(check, observer, target, FAILED, "", found)


@pytest.mark.parametrize(
    ("rows", "expected"),
    [
        ([row("b", "a", "+2.0003 s"), row("a", "b", "-1.9996 s")], "2.0 s ahead of b"),
        ([row("b", "a", "-0.1500 s"), row("c", "a", "-0.1510 s")], "0.15 s behind b and c"),
        ([row(name, "a", "+3.0 s") for name in "bcde"], "3.0 s ahead of b, c, d and 1 more"),
        ([row("b", "a", "-1795000000.1 s")], "56.9 years behind b"),
        ([row("b", "a", "+10000.0 s")], "2.8 hours ahead of b"),
        ([row("b", "a", "no answer"), row("b", "c", "+9.0 s"), row("b", "a", "0.4 ms", "ping_address")], ""),
        ([], ""),
    ],
)
def test_offset(rows, expected):
    assert offset(CLOCK, rows) == expected
