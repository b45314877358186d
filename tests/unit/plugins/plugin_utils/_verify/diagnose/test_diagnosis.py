# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The diagnosis of whole fleets: few findings whatever their size, faults beside each other, and its cost."""

import time

import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.checks.engine import Verification
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.checks.table import CHECKS
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.components.component import Component
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.diagnose import diagnosis, rules
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observe.observations import Observation
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.report import terminal
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.report.judgement import judge
from fleets import (
    INNER_CAR,
    INNER_TIBI,
    ONE,
    TWO,
    components,
    diagnose,
    diagnosed,
    fig12,
    lost_route,
    no_answer,
    observed,
    of,
    outside,
    plan,
    second_default_route,
    silent,
    update,
    wall,
    without,
)


@pytest.mark.parametrize("fleet", [plan(), plan(5), fig12(), fig12(multimaster_multicast_routing="smcroute")])
def test_a_fleet_where_all_is_well_has_no_finding(fleet):
    assert diagnosed(fleet=fleet) == diagnosis.Diagnosis()


def _wrong_name(seen):
    update(of(seen["dabo-nav"].probe.members, "car-nav"), addresses=("192.168.12.7",))


def _deaf(seen):
    """car-nav drops ICMP that comes in from others."""
    for name in seen:
        if name != "car-nav":
            update(
                of(seen[name].probe.members, "car-nav"),
                ping_address=no_answer(),
                loss=1.0,
                ping_name=no_answer(),
                ping_large=None,
            )


FAULTS = {
    wall: ("filter", "tibi-visio", "forward"),
    _wrong_name: ("names", "dabo-nav", "old"),
    _deaf: ("filter", "car-nav", "icmp in"),
    lost_route: ("route", "tibi-nav", "missing"),
}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("first", "second"), [(one, other) for one in FAULTS for other in FAULTS if one.__name__ < other.__name__]
)
def test_two_faults_beside_each_other_are_two_findings(first, second):
    if {first, second} == {wall, lost_route}:
        pytest.skip("a computer without a route behind a wall is not told apart")

    def change(seen):
        first(seen)
        second(seen)

    found = diagnosed(change, fig12())
    assert sorted(components(found)) == sorted([FAULTS[first], FAULTS[second]]), found


def test_a_fault_that_much_follows_from_comes_before_one_that_a_value_shows():
    def change(seen):
        wall(seen)
        second_default_route(seen)

    filter_, routes = diagnosed(change, fleet=fig12()).findings
    assert filter_.component.kind == "filter" and len(filter_.rows) > 50, filter_
    assert routes.component[:3] == ("route", "car-ext", "defaults") and routes.proof, routes


def _flapping(seen):
    """The cable of the first of five computers was out while all others counted pings to it, and it to one of them."""
    for number in range(2, 6):
        update(of(seen[f"kobuki{number}computer"].probe.members, ONE), loss=0.9)
        update(of(seen[f"kobuki{number}computer"].multicast.udp, ONE), loss=0.4)


def test_the_lossy_link_is_named_and_not_the_network():
    """Most of the fleet's pings need the network and arrive, more than those that also need the link."""
    (found,) = diagnosed(_flapping, plan(5)).findings
    assert found.component[:3] == ("link", ONE, "loss") and not found.rivals


def test_what_is_behind_a_gateway_that_is_off_was_not_examined():
    fleet = fig12()
    seen = observed(fleet)
    robot = [*INNER_CAR, "car-visio"]
    silent(seen, [*outside("car"), "router"], robot)
    for name in robot:
        seen[name] = Observation(unreachable=True, problem="no route to host")
    for one in seen.values():
        if one.probe:
            update(one.probe, topics=[entry for entry in one.probe.topics if not entry.computer.startswith("car")])
            update(one.probe.list_masters, masters=without(one.probe.list_masters.masters, "car-visio"))
    verification = Verification(CHECKS, fleet, seen)
    summary = judge(verification, False, False).summary
    found = diagnosis.explain_rows(verification, summary.notable)
    assert components(found) == [("computer", "car-visio", "off")]
    text = terminal.render(summary, found)
    assert "not examined: " in text and all(name in text.partition("not examined: ")[2] for name in INNER_CAR)


def test_of_very_many_results_some_are_explained(monkeypatch):
    monkeypatch.setattr(diagnosis, "MOST", 50)
    found = diagnosed(wall, fig12())
    assert components(found) == [("filter", "tibi-visio", "forward")]
    assert found.looked_at <= 60 < found.total


@pytest.mark.slow
def test_one_fault_in_a_large_fleet_is_one_finding_in_seconds():
    fleet = plan(robots=40)
    seen = observed(fleet)
    silent(seen, [name for name in seen if name != TWO], [TWO])
    seen[TWO] = Observation(unreachable=True, problem="no route to host")
    for one in seen.values():
        if one.probe:
            update(one.probe, topics=without(one.probe.topics, TWO, "computer"))
            update(one.probe.list_masters, masters=without(one.probe.list_masters.masters, TWO))
    began = time.process_time()
    found = diagnose(fleet, seen)
    assert components(found) == [("computer", TWO, "off")]
    assert time.process_time() - began < 20.0


def test_robots_are_not_mixed_up():
    def change(seen):
        for name in INNER_TIBI:
            update(seen[name].probe.roscore, answer="http://localhost:11311/")

    found = diagnosed(change, fig12())
    assert components(found) == [("roscore", "tibi-visio", "name")]
    assert ONE not in str(found)


def test_of_packets_that_end_at_one_place_the_first_are_told():
    """Each has many words; the report has those of all beside the finding."""
    first, second = (Component("way", "tibi-gate", "ends", f"pings from {name} end there") for name in ("arm", "nav"))
    told = diagnosis.Finding(first, also=(second,)).sentence()
    assert told == "packets end at tibi-gate: pings from arm end there"


def test_what_follows_from_a_consequence_is_given_to_its_cause(monkeypatch):
    """A fault follows from another one, and that one from a third: no row is lost, and nothing stops."""
    fleet, names = plan(3), ("kobuki1computer", "kobuki2computer", "kobuki3computer")
    seen = observed(fleet)
    for name in names[:2]:
        update(of(seen[name].probe.services, "discovery"), active_state="failed", sub_state="failed")
    update(of(seen[names[2]].probe.members, names[0]), addresses=("192.168.1.77",))
    update(of(seen[names[2]].probe.members, names[1]), ping_address=no_answer(), ping_name=no_answer(), loss=1.0)
    dead = [Component("discovery", name, "dead") for name in names[:2]]
    cause = Component("names", names[2], "old", names[0])
    causes = {names[0]: dead[1], names[1]: cause}

    def find_cause(_effects, row, _suspects):
        return causes.get(row.observer) if row.check == "services" else None if row.target == names[0] else dead[0]

    monkeypatch.setattr(rules.Effects, "find_cause", find_cause)
    verification = Verification(CHECKS, fleet, seen)
    rows = [row for row in verification.rows() if row.verdict != "ok"]
    found = diagnosis.explain_rows(verification, rows)
    assert components(found)[0] == cause[:3]
    told = [row for entry in found.findings for row in (*entry.proof, *entry.rows)]
    assert {*told, *found.unexplained} == {*rows}
    assert {("services", name) for name in names[:2]} <= {(row.check, row.observer) for row in found.findings[0].rows}
