# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The diagnosis on simulated fleets, in small numbers: `python -m tests.simulator` has the large ones."""

from random import Random

import pytest

from tests.simulator import faults, harness, inventories
from tests.simulator.observe import observe
from tests.simulator.state import healthy

pytestmark = pytest.mark.whole

HEALTHY, ROUNDS, PAIRS = 40, 1, 20
# What is reached; raise them with the diagnosis.
FIRST, NAMED, FIRST_OF_PAIRS = 0.93, 0.96, 0.85
ONE = 0.95  # of the faults that come alone: so many are one finding


def share(table, *verdicts):
    total = sum(score.verdicts.total() for score in table.values())
    return sum(score.verdicts[verdict] for score in table.values() for verdict in verdicts) / total


def test_a_healthy_fleet_has_no_finding():
    assert not list(harness.false_alarms(range(HEALTHY)))


@pytest.mark.slow
def test_one_fault_is_named_first():
    table = harness.scores(harness.single_faults(range(ROUNDS * len(faults.FAULTS))))
    assert share(table, harness.FIRST) >= FIRST, harness.render_misses(table)
    assert share(table, harness.FIRST, harness.EQUAL) >= NAMED, harness.render_misses(table)
    single = sum(score.findings[1] for score in table.values())
    assert single >= ONE * sum(score.findings.total() for score in table.values()), harness.render_findings(table)


@pytest.mark.costly
def test_two_faults_are_among_the_first_three():
    table = harness.scores(harness.pairs_of_faults(range(PAIRS)))
    assert share(table, harness.FIRST, harness.EQUAL) >= FIRST_OF_PAIRS, harness.render_misses(table)


NEVER = [row for row in faults.FAULTS if row.name == "site.yml never ran"]


@pytest.mark.parametrize("number", range(1, 13))
def test_a_computer_where_site_never_ran_is_one_finding(number):
    ((trial, [(_row, place, _verdict)], findings),) = harness.single_faults([number], NEVER)
    assert [(part.kind, part.place) for part, *_rivals in findings] == [("set_up", place)], trial


@pytest.mark.parametrize("number", range(8))
def test_a_fleet_where_site_never_ran_is_one_finding(number):
    random = Random(number)
    fleet = inventories.plan(random)
    state = healthy(random, fleet)
    for name in fleet.computers:
        state = faults.never_set_up(state, random, state.world.machines[name])
    (finding,) = harness.diagnose(fleet, observe(state, None, number)).findings
    assert finding.sentence().startswith("site.yml has not run on any computer of this run")


def test_a_second_address_of_the_own_name_is_named():
    rows = [faults.BY_NAME["name with two addresses"]]
    ((_trial, [(_row, place, verdict)], findings),) = harness.single_faults([11], rows)
    assert [(part.kind, part.place, part.mode) for part, *_rivals in findings] == [("names", place, "own")]
    assert verdict == harness.FIRST


def test_a_prefix_that_is_too_short_is_one_finding():
    """The computer looks for those of other networks on its own, where nobody answers."""
    trial = harness.draw(47, [[faults.BY_NAME["another prefix length"]]])
    (parts,) = harness.named(trial)
    assert (parts[0].kind, parts[0].mode) == ("interface", "prefix")
