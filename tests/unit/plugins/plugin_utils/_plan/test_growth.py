# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The work for the plan of a large fleet, counted in lines of code that run: so a busy machine changes nothing."""

import sys
from collections import Counter
from pathlib import Path

import fleets
import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._inventory import read
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan.plan import fleet_plan


def count_lines(computers):
    """Count the lines that run for a plan, by the folder of their file."""
    inventory, lines = fleets.behind_gateways(computers), Counter()

    def count(frame, event, _argument):
        lines[Path(frame.f_code.co_filename).parent.name] += event == "line"
        return count

    before = sys.gettrace()
    sys.settrace(count)
    try:
        fleet_plan(read.read_fleet(inventory))
    finally:
        sys.settrace(before)
    return lines


@pytest.mark.slow
def test_twice_the_computers_are_twice_the_work():
    count_lines(8)  # what is kept after the first plan
    small, large = count_lines(96), count_lines(192)
    assert large["_inventory"] / small["_inventory"] < 2.1  # all is read and compared
    # Each gateway has a route to each other robot, and each discovery node knows it: pairs of robots.
    assert large["_plan"] / small["_plan"] < 3
    assert large.total() / small.total() < 2.3
