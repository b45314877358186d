# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The module multimaster_logs refuses what is no service or no number. What it reads: tests/systems/test_bundle.py."""

import pytest
from ansible_collections.rosfleet.multimaster.plugins.modules.multimaster_logs import wrong


@pytest.mark.parametrize("name", ["../x", "a b", "-x", "", "sync\n", "*"])
def test_a_name_that_is_none(name):
    assert wrong(["sync", name], 200).startswith("services has ")


@pytest.mark.parametrize("lines", [0, -1, 1001])
def test_a_number_that_is_out_of_bounds(lines):
    assert "expected a number from 1 to 1000" in wrong(["sync"], lines)


def test_what_the_plan_has():
    assert wrong(["address", "roscore", "multicast-routing"], 200) == ""
