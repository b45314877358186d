# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The simulator: healthy fleets are seen as such, every fault is seen, and what is seen could come from the modules.

`python -m tests.simulator` has the large numbers.
"""

import copy
from collections import Counter
from random import Random

import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._base.plain import from_plain, to_plain
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.checks.engine import FAILED, OK, Verification
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.checks.table import CHECKS
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observe.observations import Observation

from tests.simulator import faults, harness, inventories
from tests.simulator.observe import observe
from tests.simulator.state import healthy

pytestmark = pytest.mark.whole

FLEETS = 40
# They hinder nobody now, so that they are warnings.
HARMLESS = {
    "a node that hangs", "a node without a roscore", "a node at the roscore of another robot", "a node without a registration",
    "a stranger", "ghosts", "group pruned", "strict reverse path", "two default routes", "filter of the group",
    "discovery on another group", "filter of UDP", "filter of UDP out", "a third lost", "small MTU", "masquerading",
    "other message definitions", "another prefix length", "another address",
    "large packets not forwarded", "large packets lost", "duplicate address",
}  # fmt: skip


def verdicts(trial):
    findings = Verification(CHECKS, trial.state.fleet, trial.observations).rows()
    return {
        finding.verdict
        for finding in findings
        if finding.verdict != OK and finding.observer not in trial.noise and not heard_inside(trial, finding)
    }


def heard_inside(trial, finding):
    """A gateway hears the master behind it on its inner interface, where smcroute has joined the group."""
    fleet = trial.state.fleet
    one, other = (fleet.computers[name] for name in (finding.observer, finding.target))
    routed = fleet.multicast_routing != "none" and one.is_gateway and one.robot == other.robot
    return finding.check == "udp_multicast" and routed


def test_healthy_fleets_have_no_failed_finding():
    for number in range(FLEETS):
        assert FAILED not in verdicts(harness.draw(number, [])), number


def test_inventories_are_of_both_layouts_with_many_variables():
    plans = [inventories.plan(Random(number)) for number in range(FLEETS)]
    assert {bool(plan.networks) for plan in plans} == {True, False}
    assert any(entry.device for plan in plans for entry in plan.networks)
    assert {plan.transport for plan in plans} == {"both", "unicast", "multicast"}
    assert any(plan.router and plan.router.name for plan in plans) and any(plan.let_in for plan in plans)
    assert any(plan.multicast_routing == "smcroute" for plan in plans) and any(plan.flows for plan in plans)
    computers = [computer for plan in plans for computer in plan.computers.values()]
    assert {computer.provider for computer in computers} == {"bundled", "fkie_existing"}
    assert any(computer.routes_expected for computer in computers)


@pytest.mark.parametrize("row", faults.FAULTS, ids=[row.name for row in faults.FAULTS])
def test_every_fault_is_seen(row):
    """Each of some trials differs from the healthy fleet; `draw` sees to that, and ends."""
    found = set()
    for number in range(2):
        trial = harness.draw(number, [[row]])
        assert [(one.name, place) for one, place in trial.faults] and trial.run
        found |= verdicts(trial)
    assert FAILED in found or row.name in HARMLESS and found, found


def test_a_trial_is_the_same_every_time():
    one, other = (harness.draw(7, [faults.FAULTS, faults.FAULTS]) for _time in range(2))
    assert one.observations == other.observations and one.faults == other.faults


def test_what_is_seen_has_the_types_of_the_modules_results():
    for number in range(10):
        trial = harness.draw(number, [faults.FAULTS])
        for observation in trial.observations.values():
            assert from_plain(Observation, copy.deepcopy(to_plain(observation))) == observation


def test_nothing_but_lost_packets_depends_on_the_seed():
    fleet = inventories.plan(Random(3))
    state = healthy(Random(3), fleet)
    one, other = observe(state, seed=1), observe(state, seed=2)
    for name in fleet.computers:
        assert one[name].probe.services == other[name].probe.services
        assert [entry.route for entry in one[name].probe.members] == [
            entry.route for entry in other[name].probe.members
        ]


@pytest.mark.slow
def test_what_is_only_counted_is_what_good_rows_say():
    """A judge returns early where nobody reads its sentences; all else is the same row for row."""
    for number in range(0, len(faults.FAULTS), 2):
        trial = harness.draw(number, [[faults.FAULTS[number]]])
        verification, passed = Verification(CHECKS, trial.state.fleet, trial.observations), Counter()
        rows, made = list(verification.rows()), list(verification.rows(passed))
        counted = Counter()
        for (own, its, checks), pairs in passed.items():
            counted.update({(own, its, check): pairs for check in checks})
        robots = {name: plan.robot or name for name, plan in trial.state.fleet.computers.items()}
        good = [row for row in rows if row.verdict == OK and row.observer != row.target]
        assert counted == Counter((robots[row.observer], robots[row.target], row.check) for row in good)
        assert made == [row for row in rows if row.verdict != OK or row.observer == row.target]
