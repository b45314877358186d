# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The pairs that a verification tries: all of a small fleet, and of a large one enough to exercise every part."""

from collections import Counter

import fleets
import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.checks.engine import Verification
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.checks.table import CHECKS
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.context import pairs
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.diagnose import diagnosis
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observe.observations import Ping
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.report import terminal
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.report.judgement import judge
from hypothesis import example, given, settings
from hypothesis import strategies as st


def of_rings(sizes):
    """The networks of computers: one entry for each ring of so many."""
    return {f"r{ring}c{place}": f"net{ring}" for ring, size in enumerate(sizes) for place in range(size)}


def test_up_to_thirty_computers_try_all_pairs():
    networks = of_rings([4] * 7 + [2])
    assert len(networks) == pairs.ALL_UP_TO
    chosen = pairs.choose_pairs(networks, networks)
    assert pairs.number(chosen) == 30 * 29
    assert all(chosen[name] == networks.keys() - {name} for name in networks)


def test_all_tries_all_pairs_of_any_fleet():
    networks = of_rings([4] * 20)
    assert pairs.number(pairs.choose_pairs(networks, networks, pairs.ALL)) == 80 * 79


@settings(max_examples=60, deadline=None)
@example([1, 30], 0)
@example([1] * 31, 0)
@example([2] * 16, 0)
@example([3] * 70, 7)
@given(
    st.lists(st.integers(1, 40), min_size=1, max_size=70).filter(lambda sizes: sum(sizes) > pairs.ALL_UP_TO),
    st.sampled_from([0, 3, 7]),
)
def test_every_way_between_two_networks_in_both_directions(sizes, step):
    networks = of_rings(sizes)
    sealed = {f"r{ring}c0" for ring, size in enumerate(sizes) if step and size > 1 and ring % step == 0}  # do not look
    looking = [name for name in networks if name not in sealed]
    chosen = pairs.choose_pairs(networks, [*looking, "router"])
    assert all(name not in targets and targets <= networks.keys() for name, targets in chosen.items())
    robots = {name: targets for name, targets in chosen.items() if name in networks}
    looked_at = Counter(target for targets in robots.values() for target in targets)
    assert min(looked_at[name] for name in networks) >= 2
    assert min(len(targets) for targets in robots.values()) >= 2
    # the computers of each network together, and the router, try every other network
    tried = {}
    for name, targets in chosen.items():
        tried.setdefault(networks.get(name), set()).update(networks[target] for target in targets)
    assert tried.keys() == {None, *networks.values()}
    assert all(found >= set(networks.values()) - {network} for network, found in tried.items())


def test_proofs_grow_with_computers_and_not_with_pairs():
    small, large = (pairs.number(pairs.choose_pairs(of_rings([size]), of_rings([size]))) for size in (100, 400))
    assert (small, large) == (200, 800)
    of_robots = {robots: of_rings([4] * robots) for robots in (25, 50, 100)}
    found = {
        robots: pairs.number(pairs.choose_pairs(of_it, of_it)) / (4 * robots) for robots, of_it in of_robots.items()
    }
    assert found == {25: 24 + 2, 50: 24.5 + 2, 100: 24.75 + 2}  # each tries


def test_pairs_of_many_small_networks_grow_with_the_networks():
    networks = of_rings([2] * 100)
    assert pairs.number(pairs.choose_pairs(networks, networks)) == 100 * 99 + 200


@pytest.mark.parametrize(
    "sizes, least, most",
    [([4] * 100, 20, 34), ([4, 2] * 40, 15, 90), ([8] * 60 + [4] * 60, 15, 80), ([4, 2, 1] * 30, 15, 110)],
    ids=["equal", "by turns", "large first", "with single ones"],
)
def test_each_computer_of_a_network_is_looked_at_about_as_often(sizes, least, most):
    networks = of_rings(sizes)
    chosen = pairs.choose_pairs(networks, networks)
    looked_at = Counter(target for targets in chosen.values() for target in targets)
    assert least <= min(looked_at.values()) and max(looked_at.values()) <= most


def test_computers_of_one_network_that_share_others_take_different_targets_there():
    networks = of_rings([8] * 60 + [4] * 60)
    chosen = pairs.choose_pairs(networks, networks)
    from_network = Counter((networks[name], target) for name, targets in chosen.items() for target in targets)
    assert all(count == 1 for (network, target), count in from_network.items() if networks[target] != network)


def test_computers_that_are_not_in_the_run_leave_no_way_out():
    networks = of_rings([4] * 100)
    present = [name for name in networks if not name.endswith(("c0", "c2"))]
    chosen = pairs.choose_pairs(networks, present)
    for network in set(networks.values()):
        tried = {networks[target] for name in present if networks[name] == network for target in chosen[name]}
        assert tried == set(networks.values())


@pytest.mark.slow
def test_a_fault_in_a_sampled_fleet_is_named():
    fleet = fleets.plan(robots=12, computers=3)
    seen = fleets.observed(fleet)
    victim = "kobuki3computer-1"
    for name, computer in seen.items():
        for member in computer.probe.members:
            if victim in (name, member.name) and name != member.name:
                fleets.update(
                    member, ping_address=Ping(error="no answer to 3 requests"), ping_name=Ping(error="none"), loss=1.0
                )
    verification = Verification(CHECKS, fleet, seen, pairs.AUTO)
    summary = judge(verification, False, False).summary
    some, everything = summary.pairs
    assert everything == 36 * 35
    assert some < everything / 4
    assert f"{some} of {everything} pairs were tried" in terminal.render(summary, diagnosis.Diagnosis())
    found = diagnosis.explain_rows(verification, summary.notable)
    assert ("filter", victim) in {(entry.component.kind, entry.component.place) for entry in found.findings}, found


@pytest.mark.slow
def test_pairs_that_were_not_tried_are_no_findings():
    fleet = fleets.plan(robots=12, computers=3)
    chosen = pairs.choose_pairs({member.name: str(member.network) for member in fleet.members}, fleet.computers)
    seen = fleets.observed(fleet)
    for name, computer in seen.items():
        probe = computer.probe
        fleets.update(
            probe,
            members=[entry for entry in probe.members if entry.name in chosen[name] or entry.name == name],
            topics=[entry for entry in probe.topics if entry.computer in chosen[name]],
        )
    verification = Verification(CHECKS, fleet, seen, pairs.AUTO)
    summary = judge(verification, False, False).summary
    assert not summary.notable
    whole = Verification(CHECKS, fleet, seen, pairs.ALL)
    assert judge(whole, False, False).summary.notable  # the talkers of the others are missed


def test_streams_go_to_all_that_are_tried_where_there_is_time():
    networks = of_rings([4] * 3)
    chosen = pairs.choose_pairs(networks, networks)
    assert {name: set(to) for name, to in pairs.streams(chosen, list(networks), 0.5).items()} == chosen


@settings(max_examples=60, deadline=None)
@example([4] * 100, 0.5)
@example([1] * 30, 2.0)
@given(st.lists(st.integers(1, 20), min_size=1, max_size=30), st.sampled_from([0.1, 0.5, 2.0]))
def test_streams_together_have_a_limit_and_each_computer_sends(sizes, seconds):
    networks = of_rings(sizes)
    chosen = pairs.choose_pairs(networks, networks)
    found = pairs.streams(chosen, list(networks), seconds)
    assert all(set(to) <= set(chosen[name]) and len(to) == len(set(to)) for name, to in found.items())
    assert all(found[name] for name in networks if chosen[name])
    assert pairs.number(found) * seconds <= max(pairs.STREAMS, len(networks) * seconds)


def test_whom_one_computer_leaves_out_the_next_one_takes():
    networks = of_rings([4] * 100)
    found = pairs.streams(pairs.choose_pairs(networks, networks), list(networks), 0.5)
    assert pairs.number(found) == 400 and len({target for to in found.values() for target in to}) > 390
