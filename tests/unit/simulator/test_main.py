# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The program of the simulator says why a finding was made."""

from tests.simulator import faults
from tests.simulator.__main__ import explain


def test_a_trial_says_why_each_finding_was_made():
    first, *lines = explain(0, faults.BY_NAME["filter of ICMP"])
    assert first.startswith("filter of ICMP at ")
    labels = [line.split()[0] for line in lines]
    assert labels.count("Finding") == labels.count("decided") == labels.count("wrong?") > 0
