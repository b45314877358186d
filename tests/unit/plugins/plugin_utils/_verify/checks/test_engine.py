# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The engine over the whole table of checks: good fleets, failures that explain each other, parts of a fleet, cost."""

import copy
import dataclasses
import sys
import time
from collections import Counter

import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.checks.table import CHECKS
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observe.observations import (
    MasterList,
    RoscoreAnswer,
    Talker,
)
from fleets import (
    ONE,
    ROBOTS,
    TWO,
    evaluate,
    fig12,
    good,
    judged,
    notable,
    observed,
    of,
    plan,
    update,
    without,
)


def test_everything_is_checked_and_good():
    findings = evaluate()
    between_networks = {"forwarding", "reverse_path", "redirects", "next_boot_route", "outer_route"}
    only_where_something_failed = {"tcp_answer", "set_up"}
    only_if_wanted = {
        *(
            "throughput",
            "sealed",
            "copies",
            "time_source",
            "own_tunnel",
            "guard",
            "tunnel",
            "relay",
            "relay_types",
            "relay_reached",
            "relay_data",
        ),
        "arp_filter",  # where nft is there
        "simulated_time",  # where a roscore says so
    }
    assert {finding.check for finding in findings} == {check.id for check in CHECKS} - (
        between_networks | only_where_something_failed | only_if_wanted
    )
    assert not notable(findings)
    pairs = {(finding.observer, finding.target) for finding in findings}
    assert pairs == {(ONE, ONE), (ONE, TWO), (TWO, ONE), (TWO, TWO)}


def test_everything_is_good_between_three_robot_networks():
    findings = evaluate(fleet=fig12())
    assert not notable(findings)
    numbers = Counter(finding.check for finding in findings)
    assert numbers["topic_heard"] == numbers["direct_connection"] == 9 * 8
    assert (numbers["forwarding"], numbers["reverse_path"], numbers["redirects"]) == (4, 4, 1)
    assert (numbers["udp_multicast"], numbers["udp_unicast"]) == (3 * 2, 4 * 3)  # the gateways, and dabo-nav by unicast
    router = {finding.check for finding in findings if finding.observer == "router"}
    assert router == {
        "forwarding",
        "open_files",
        "reachable",
        "measured",
        "address_once",
        "answers_arp",
        "addresses",
        "mtu",
        "reverse_path",
        "redirects",
        "answers_pings",
        "packet_filter",
        "as_planned",
        "overlaps",
        "next_boot_sysctl",
        "next_boot_route",
    } | {
        "default_routes",
        "route",
        "outer_route",
        "ping_address",
        "source",
        "ping_large",
        "ping_loss",
    }


def test_with_multicast_routing_inner_masters_hear_the_group_too():
    findings = evaluate(fleet=fig12(multimaster_multicast_routing="smcroute"))
    assert not notable(findings)
    assert Counter(finding.check for finding in findings)["udp_multicast"] == 4 * 3


@pytest.mark.parametrize("names", [["tibi-nav"], ["router"], list(ROBOTS["dabo"][3]), ["car-visio", "router"]])
def test_with_limit_any_component_of_the_fleet_is_judged(names):
    fleet = fig12()
    findings = judged(fleet, {name: good(fleet, name) for name in names})
    assert not notable(findings)
    assert {finding.observer for finding in findings} == set(names)


def test_with_limit_only_the_computers_of_the_run_are_judged():
    fleet = plan()
    seen = copy.deepcopy(good(fleet, ONE))
    update(seen.probe, topics=())  # nobody talks there, and nobody listens
    update(of(seen.multicast.udp, TWO), heard_from=False, unicast=None)
    findings = judged(fleet, {ONE: seen})
    assert not notable(findings)
    assert {finding.observer for finding in findings} == {ONE}
    assert {"name", "ping_name", "list_masters"} <= {finding.check for finding in findings if finding.target == TWO}


def test_a_second_computer_without_ros_keeps_nobody_waiting():
    fleet = fig12()

    def change(seen):
        for name, one in seen.items():
            update(one.probe, topics=without(one.probe.topics, "tibi-nav", "computer"))
            if name == "tibi-nav":
                update(
                    one.probe,
                    ros_missing="there is no command rostopic",
                    topics=(),
                    list_masters=MasterList(error="there is no command rosservice"),
                    talker=Talker(running=False, error="there is no command rostopic"),
                )

    findings = evaluate(change, fleet)
    assert not notable(findings)
    assert Counter(finding.check for finding in findings)["topic_heard"] == 8 * 7


def test_a_second_computer_may_be_without_ros():
    fleet = plan(computers=2)
    second = ONE + "-1"

    def change(seen):
        for one in seen.values():
            update(one.probe, topics=without(one.probe.topics, second, "computer"))
        update(
            seen[second].probe,
            roscore=RoscoreAnswer(error="no file"),
            ros_missing="no file",
            talker=Talker(running=False, error="no file"),
            list_masters=MasterList(error="no file"),
            topics=(),
        )

    findings = evaluate(change, fleet)
    assert not notable(findings)
    assert not {"list_masters", "topic_heard"} & {finding.check for finding in findings if finding.observer == second}


@pytest.mark.slow
def test_the_cost_grows_with_the_observations():
    fleet = plan(robots=40)
    seen = observed(fleet)
    began = time.process_time()
    findings = judged(fleet, seen)
    assert len(findings) > 40 * 39 * 10
    assert time.process_time() - began < 0.0005 * len(findings)  # some 10 microseconds each on a PC


class Counted(str):
    """A text of an observation, which counts with how many others it is compared."""

    comparisons = 0

    def __eq__(self, other):
        Counted.comparisons += 1
        return str.__eq__(self, other)

    __hash__ = str.__hash__


def counted(value):
    """The same observation with texts that count."""
    if isinstance(value, str):
        return Counted(value)
    if isinstance(value, tuple):
        return tuple(map(counted, value))
    if dataclasses.is_dataclass(value):
        return type(value)(**{field.name: counted(getattr(value, field.name)) for field in dataclasses.fields(value)})
    return value


def work(function):
    """The number of Python functions that a function calls, and of comparisons of observed texts."""
    calls = 0

    def called(frame, event, argument):
        nonlocal calls
        calls += event == "call" and frame.f_code is not Counted.__eq__.__code__

    Counted.comparisons = 0
    sys.setprofile(called)
    try:
        result = function()
    finally:
        sys.setprofile(None)
    return result, calls, Counted.comparisons


@pytest.mark.slow
def test_the_work_for_a_pair_does_not_grow_with_the_fleet():
    """Twice and three times the robots: four and nine times the pairs, and for each pair the same work."""
    per_finding = []
    for robots in (4, 8, 12):
        fleet = plan(robots, 4)
        seen = {name: counted(observation) for name, observation in observed(fleet).items()}
        found, calls, comparisons = work(lambda fleet=fleet, seen=seen: judged(fleet, seen))
        assert {finding.verdict for finding in found} == {"ok"}
        per_finding.append((calls / len(found), comparisons / len(found)))
    for first, later in zip(per_finding[0], per_finding[2], strict=True):
        assert later <= 1.2 * first, per_finding


@pytest.mark.slow
def test_a_computers_plan_costs_the_same_in_any_fleet():
    per_computer = [work(lambda robots=robots: plan(robots, 4))[1] / robots for robots in (10, 40)]
    assert per_computer[1] <= 1.5 * per_computer[0], per_computer
