# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Consequences of a fault that a value shows are counted there, and are no findings."""

import pytest

from tests.simulator import faults, harness

# The fault of a simulated fleet, and numbers of trials in which it had several findings before.
ONE = {
    "interface down": (67, 5),
    "another address": (2, 250, 312, 560),
    "another route": (385,),
    "no route": (322,),
    "switch off": (526,),
    "name on loopback": (8,),
    "name with an old address": (567,),
    "names for root alone": (177, 363),
    "ROS_MASTER_URI wrong": (40,),
    "sync dead": (48,),
}


@pytest.mark.slow
@pytest.mark.parametrize(("name", "number"), [(name, number) for name, numbers in ONE.items() for number in numbers])
def test_what_follows_from_a_fault_is_no_finding(name, number):
    trial = harness.draw(number, [[faults.BY_NAME[name]]])
    (found,) = harness.named(trial)
    assert harness.is_right(found[0], *trial.faults[0])
