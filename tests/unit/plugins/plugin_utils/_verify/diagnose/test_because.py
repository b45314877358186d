# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The reasons for a finding: the rule that won, its evidence, and the successes that cleared the rivals."""

import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.checks.engine import Verification
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.checks.table import CHECKS
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.diagnose import evidence
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.diagnose.evidence import (
    INFERRED,
    LOCATED,
    SEEN,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.diagnose.rules import BY_ID, RULES
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observe.observations import FilterChains
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observe.outcomes import Outcome
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.report import content
from fleets import diagnose, diagnosed, fig12, lost_route, observed, update, wall

from tests.simulator import faults, harness
from tests.unit.plugins.plugin_utils._verify.trace.test_findings import GATE, follow, lose_behind_wall


def first(diagnosis):
    return diagnosis.findings[0].because


def reasons(because):
    return {(one.kind, one.mode, one.place): one for one in because.rivals}


def test_the_rules_are_one_table_in_order():
    assert len(BY_ID) == len(RULES) == 10
    assert [rule.id for rule in RULES if rule.certainty == SEEN] == [rule.id for rule in RULES[:6]]


def test_a_value_shows_it_and_the_rest_follows():
    because = first(diagnosed(lost_route, fig12()))
    assert (because.rule, because.certainty, because.place) == ("value", SEEN, 3)
    (shown, *_more) = because.shown_by
    assert (shown.kind, shown.check, shown.observer) == (evidence.VALUE, "route", "tibi-nav")
    assert shown.source == "checks/network.py" and shown.trace is None
    assert {one.rule for one in because.explains} == {"value", "effect"}


def test_what_is_concluded_says_what_cleared_the_rivals():
    because = first(diagnosed(wall, fig12()))
    assert (because.rule, because.certainty) == ("cover", INFERRED)
    assert because.shown_by[0].kind == evidence.INFERENCE
    forwarding = reasons(because)["forwarding", "off", "tibi-visio"]
    assert forwarding.cleared and forwarding.reason == evidence.SUCCESS and forwarding.id == "RF-271"
    assert (forwarding.check, forwarding.observer) == ("forwarding", "tibi-visio")


def test_an_errno_of_its_own_kernel_is_kept():
    fleet = fig12()
    seen = observed(fleet)
    for entry in seen["dabo-visio"].probe.masters:
        update(entry, open=False, error="EADDRNOTAVAIL", outcome=Outcome.NO_LOCAL_PORT)
    (entry,) = [
        one for one in diagnose(fleet, seen).findings if one.component[:3] == ("computer", "dabo-visio", "ports")
    ]
    assert (entry.because.rule, entry.because.certainty) == ("errno", SEEN)
    assert {(one.kind, one.detail) for one in entry.because.shown_by} == {(evidence.ERRNO, "no_local_port")}


def test_a_trace_has_its_steps_as_values():
    fleet, seen = lose_behind_wall(FilterChains(True, ()))
    follow(fleet, seen)
    because = first(diagnose(fleet, seen))
    assert (because.rule, because.certainty) == ("trace-end", LOCATED)
    trace = because.shown_by[0].trace
    assert trace.disposition == "hop" and trace.hops[-1].computer == GATE
    assert [step.action for step in trace.hops[-1].steps] == ["came in", "ends"]


@pytest.fixture(scope="module")
def trials():
    """The diagnosis of one fault of each kind."""
    found = []
    for number, row in enumerate(faults.FAULTS):
        trial = harness.draw(number, [[row]])
        found.append((trial, harness.diagnose(trial.state.fleet, trial.observations)))
    return found


@pytest.mark.slow
def test_each_finding_has_a_rule_that_fits(trials):
    rules, said = set(), set()
    for trial, diagnosis in trials:
        for entry in diagnosis.findings:
            because = entry.because
            rules.add(because.rule)
            assert because.certainty == entry.sure == BY_ID[because.rule].certainty, (trial.number, entry.component)
            assert because.shown_by and sum(one.rows for one in because.explains) >= 1
            said |= {one.reason for one in because.rivals}
            assert all(one.check for one in because.rivals if one.reason == evidence.SUCCESS)
            assert all(one.detail for one in because.shown_by if one.kind in (evidence.BLOCKING_RULE, evidence.ERRNO))
    assert {"rule-drops", "value", "cover", "loss"} <= rules
    assert {evidence.SUCCESS, evidence.EQUAL, evidence.OUTWEIGHED, evidence.FEWER} <= said


@pytest.mark.slow
def test_a_finding_and_its_data_do_not_depend_on_the_question(trials):
    """Rivals are weighed after all is decided: a second diagnosis of the same is the same."""
    trial, diagnosis = trials[0]
    again = harness.diagnose(trial.state.fleet, trial.observations)
    assert content.list_findings(again) == content.list_findings(diagnosis)


def test_no_finding_no_reason():
    fleet = fig12()
    assert not content.list_findings(diagnosed(None, fleet)) and Verification(CHECKS, fleet, {}).inventory.path == ""
