# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Checks of one computer by itself: the causes that are told, for two robots and between three robot networks."""

import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.checks import computer
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.checks.by_hand import BY_HAND
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.engine import FAILED, UNKNOWN, WARNING
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observations import Observation, PacketFilter
from fleets import (
    ONE,
    ROBOTS,
    TWO,
    assert_told,
    assert_told_between_networks,
    evaluate,
    fig12,
    good,
    judged,
    notable,
    observed,
    of,
    outside,
    plan,
    second_default_route,
    silent,
    untold,
    update,
    wall,
    without,
)


def _service(**values):
    return lambda seen: update(seen[ONE].probe.services[1], **values)


def _roscore(**values):
    return lambda seen: update(seen[ONE].probe.roscore, **values)


def _filter(seen):
    update(seen[ONE], packet_filter=PacketFilter(changed=True, msg="The rules of nftables would be changed."))


CAUSES = [
    (_filter, "packet_filter", FAILED, "run site.yml"),
    (_service(load_state="not-found", active_state="inactive", sub_state="dead"), "services", FAILED, "not set up"),
    (_service(active_state="failed", sub_state="failed"), "services", FAILED, "journalctl"),
    (_service(restarts=4), "services", WARNING, "ends by itself"),
    (_service(differing=None), "environment", UNKNOWN, "containers"),
    (_service(differing=["ROS_HOSTNAME"]), "environment", FAILED, "after the service started"),
    (_roscore(answer="http://localhost:11311/"), "master_uri", FAILED, "only its own computer understands"),
    (_roscore(answer="http://old:11311/"), "master_uri", FAILED, "another host name"),
    (_roscore(answer="", error="Connection refused"), "master_uri", FAILED, "no roscore answers"),
]


@pytest.mark.parametrize(("change", "check", "verdict", "part"), CAUSES)
def test_each_cause_is_told(change, check, verdict, part):
    assert_told(change, check, verdict, part)


def _closed_gateway(seen):
    """tibi-visio does not forward."""
    update(seen["tibi-visio"].probe.forwarding, ip_forward=0)
    wall(seen)


def _kernel(computer, **values):
    return lambda seen: update(seen[computer].probe.forwarding.interfaces[0], **values)


# The change, the only check that fails by itself, its verdict, the predicate that tells it, whom and a part of the texts.
BETWEEN_NETWORKS = [
    (_closed_gateway, "forwarding", FAILED, None, {"tibi-visio"}, "run site.yml"),
    (_kernel("router", forwarding=0), "forwarding", FAILED, None, {"router"}, "run site.yml"),
    (_kernel("car-visio", rp_filter=1), "reverse_path", WARNING, None, {"car-visio"}, "rp_filter"),
    (_kernel("router", send_redirects=1), "redirects", WARNING, None, {"router"}, "send_redirects"),
]


@pytest.mark.parametrize(("change", "check", "verdict", "when", "observers", "part"), BETWEEN_NETWORKS)
def test_each_cause_between_networks_is_told(change, check, verdict, when, observers, part):
    assert_told_between_networks(change, check, verdict, when, observers, part)


def test_every_cause_has_a_row():
    checks = [check for check in computer.CHECKS if check.id not in ("reachable", "default_routes")]  # below
    by_hand = [(check.id, BY_HAND.when) for check in checks]  # test_by_hand
    assert untold(checks, CAUSES, BETWEEN_NETWORKS, by_hand) == []


def test_a_computer_that_is_down_is_named_once():
    fleet = plan(robots=3)
    seen = observed(fleet)
    seen[TWO] = Observation(unreachable=True, problem="no route to host")
    for name in (ONE, "kobuki3computer"):
        probe, multicast = seen[name].probe, seen[name].multicast
        for ping in (of(probe.members, TWO).ping_address, of(probe.members, TWO).ping_name):
            update(ping, ok=False, error="no answer")
        update(of(probe.masters, TWO, "computer"), open=False, error="no answer", clock_offset_s=None)
        update(probe.list_masters, masters=without(probe.list_masters.masters, TWO))
        update(probe, topics=without(probe.topics, TWO, "computer"))
        update(of(multicast.udp, TWO), heard_from=False, unicast=None, source_address=None)
    found = notable(judged(fleet, seen))
    assert [key for key, finding in found.items() if not finding.because] == [("reachable", TWO, TWO)]
    assert "no route to host" in found["reachable", TWO, TWO].found
    assert not any({observer, target} == {ONE, "kobuki3computer"} for _check, observer, target in found)


def test_behind_a_gateway_that_is_down_nobody_is_named():
    fleet = fig12()
    seen = observed(fleet)
    silent(seen, [*outside("car"), "router"], ROBOTS["car"][3])
    for name in ROBOTS["car"][3]:
        seen[name] = Observation(unreachable=True, problem="no route to host")
    for one in seen.values():
        if one.probe:
            update(one.probe, topics=[entry for entry in one.probe.topics if not entry.computer.startswith("car")])
            for entry in one.probe.masters:
                if entry.computer == "car-visio":
                    update(entry, open=False, error="no answer", clock_offset_s=None)
        for entry in one.multicast.udp if one.multicast else ():
            if entry.name == "car-visio":
                update(entry, heard_from=False, unicast=None, source_address=None, own_source_address=None)
    found = [finding for finding in notable(judged(fleet, seen)).values() if not finding.because]
    assert [(finding.check, finding.observer) for finding in found] == [("reachable", "car-visio")]


def test_a_computer_without_a_result_is_named():
    fleet = plan()
    seen = {ONE: good(fleet, ONE), TWO: Observation(problem="MODULE FAILURE")}
    found = notable(judged(fleet, seen))
    assert found["measured", TWO, TWO].found == "MODULE FAILURE"
    assert {observer for _check, observer, _target in found} == {TWO}


def test_a_second_default_route_of_an_inner_computer_is_told_with_its_way_out():
    found = [finding for finding in notable(evaluate(second_default_route, fig12())).values() if not finding.because]
    assert {finding.check for finding in found} == {"default_routes", "route"}
    routes = next(finding for finding in found if finding.check == "default_routes")
    assert "metric 100" in routes.found and "multimaster_routes to networks" in routes.remedy
    assert "second default route" in next(finding for finding in found if finding.check == "route").cause
