# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The work for the plan of a large fleet."""

import fleets
import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._inventory import read
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan.plan import fleet_plan
from counted import count_lines


def make_plan(inventory):
    return fleet_plan(read.read_fleet(inventory))


@pytest.mark.slow
def test_twice_the_computers_are_twice_the_work():
    make_plan(fleets.behind_gateways(8))  # what is kept after the first plan
    small, large = (count_lines(make_plan, fleets.behind_gateways(computers)) for computers in (96, 192))
    assert large["_inventory"] / small["_inventory"] < 2.1  # all is read and compared
    # Each gateway has a route to each other robot, and each discovery node knows it: pairs of robots.
    assert large["_plan"] / small["_plan"] < 3
    assert sum(large.values()) / sum(small.values()) < 2.3
