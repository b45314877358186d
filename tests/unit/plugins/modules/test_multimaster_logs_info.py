# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The module multimaster_logs_info refuses what is no service or no number. What it reads: tests/systems/test_bundle.py."""

import pytest
from ansible_collections.rosfleet.multimaster.plugins.modules.multimaster_logs_info import find_wrong_value


@pytest.mark.parametrize("name", ["../x", "a b", "-x", "", "sync\n", "*"])
def test_a_name_that_is_none(name):
    assert find_wrong_value(["sync", name], 200).startswith("services has ")


@pytest.mark.parametrize("lines", [0, -1, 1001])
def test_a_number_that_is_out_of_bounds(lines):
    assert "expected a number from 1 to 1000" in find_wrong_value(["sync"], lines)


def test_what_the_plan_has():
    assert find_wrong_value(["address", "roscore", "multicast-routing"], 200) == ""
