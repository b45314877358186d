# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Checks of the network between two computers: names, routes, pings, for two robots and between three robot networks."""

import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.checks import network
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.engine import FAILED
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.ways import Ways
from fleets import (
    INNER_CAR,
    INNER_TIBI,
    ONE,
    TWO,
    assert_told,
    assert_told_between_networks,
    evaluate,
    fig12,
    lost_route,
    no_answer,
    notable,
    of,
    outside,
    silent,
    untold,
    update,
    wall,
)


def _name(addresses, error=""):
    return lambda seen: update(of(seen[ONE].probe.members, TWO), addresses=addresses, resolve_error=error)


def _member(part, **values):
    return lambda seen: update(getattr(of(seen[ONE].probe.members, TWO), part), **values)


# One row per cause: the change, the check that names it, and a part of cause or remedy.
CAUSES = [
    (_name([], "Name or service not known"), "name", FAILED, "not known"),
    (_name(["127.0.1.1"]), "name", FAILED, "loopback"),
    (_name(["192.168.1.2", "192.168.7.7"]), "name", FAILED, "second address"),
    (_name(["192.168.7.7"]), "name", FAILED, "older address"),
    (_member("route", source="10.0.0.7"), "route", FAILED, "another interface"),
    (_member("ping_address", ok=False, error="no answer to 3 requests"), "ping_address", FAILED, "firewall drops ICMP"),
    (_member("ping_name", ok=False, error="no answer to 3 requests"), "ping_name", FAILED, "leads elsewhere"),
]


@pytest.mark.parametrize(("change", "check", "verdict", "part"), CAUSES)
def test_each_cause_is_told(change, check, verdict, part):
    assert_told(change, check, verdict, part)


def _gateway_off(seen):
    """car-visio has lost its inner interface: its robot no longer reaches it, nor anybody else."""
    silent(seen, INNER_CAR, ["car-visio", *outside("car")])
    silent(seen, [*outside("car"), "car-visio", "router"], INNER_CAR)


def _lonely(seen):
    """tibi-nav answers neither car-nav nor anybody of its own robot."""
    for observer in ("car-nav", "tibi-monitor", "tibi-visio"):
        update(of(seen[observer].probe.members, "tibi-nav"), ping_address=no_answer())


def _ping(observer, target, error="no answer to 3 requests"):
    return lambda seen: update(of(seen[observer].probe.members, target), ping_address=no_answer(error))


# The change, the only check that fails by itself, its verdict, the predicate that tells it, whom and a part of the texts.
BETWEEN_NETWORKS = [
    (lost_route, "route", FAILED, network._no_route, {"tibi-nav"}, "tibi-nav has no way out"),
    (wall, "ping_address", FAILED, network._nothing_leaves, None, "tibi-visio is reached, but passes nothing on"),
    (wall, "ping_address", FAILED, network._nothing_enters, None, "tibi-visio is reached, but passes nothing on"),
    (_gateway_off, "ping_address", FAILED, network._own_gateway_silent, None, ""),
    (_ping("car-nav", "tibi-nav"), "ping_address", FAILED, network._only_from_outside, {"car-nav"}, "do not find back"),
    (
        _ping("car-nav", "tibi-nav", "192.168.1.203 reports: communication administratively prohibited"),
        "ping_address",
        FAILED,
        network._refused_on_the_way,
        {"car-nav"},
        "refuses",
    ),
    (
        _ping("car-nav", "tibi-nav", "192.168.1.201 reports: host unreachable"),
        "ping_address",
        FAILED,
        network._gateway_finds_nobody,
        {"car-nav"},
        "its gateway tibi-visio is reached, and finds nobody",
    ),
    (
        _ping("car-nav", "tibi-nav", "192.168.1.1 reports: time to live exceeded"),
        "ping_address",
        FAILED,
        network._in_a_circle,
        {"car-nav"},
        "back to where they came from",
    ),
    (_ping("car-nav", "car-ext"), "ping_address", FAILED, None, {"car-nav"}, "client isolation"),
    (_lonely, "ping_address", FAILED, network._crosses, None, "its gateway tibi-visio"),
]


@pytest.mark.parametrize(("change", "check", "verdict", "when", "observers", "part"), BETWEEN_NETWORKS)
def test_each_cause_between_networks_is_told(change, check, verdict, when, observers, part):
    assert_told_between_networks(change, check, verdict, when, observers, part)


def test_every_cause_has_a_row():
    elsewhere = [
        ("ping_address", network._target_down),
        ("route", network._other_hop),
        ("ping_address", network._no_way_back),
        ("ping_address", network._device_passes_nothing_out),
        ("ping_address", network._device_passes_nothing_in),
    ]
    assert untold(network.CHECKS, CAUSES, BETWEEN_NETWORKS, elsewhere) == []


def test_a_silent_device_is_never_said_to_be_reached():
    """The gateway of tibi is a device of another make, which nobody asked: it may be off."""
    fleet = fig12()
    update(fleet.computers["tibi-visio"], is_gateway=False, common_address=None, is_master=True)
    update(of(fleet.members, "tibi-visio"), multicast=False)

    def change(seen):
        silent(seen, [*INNER_TIBI, "tibi-visio"], outside("tibi"))
        silent(seen, [*outside("tibi"), "router"], [*INNER_TIBI, "tibi-visio"])

    found = [finding for finding in evaluate(change, fleet) if finding.check == "ping_address" and finding.cause]
    device = "the gateway 192.168.11.101, a device of another make, is off"
    assert found and all(finding.cause.startswith(device) for finding in found), {finding.cause for finding in found}
    assert {finding.observer for finding in found} >= {"tibi-nav", "car-nav"}


WAYS = [
    ("tibi-nav", "tibi-visio", "192.168.11.100", ""),
    ("tibi-visio", "tibi-nav", "192.168.11.101", ""),
    ("tibi-nav", "dabo-nav", "192.168.11.100", "192.168.11.101"),
    ("tibi-nav", "dabo-visio", "192.168.11.100", "192.168.11.101"),
    ("tibi-visio", "dabo-nav", "192.168.1.201", "192.168.1.202"),
    ("tibi-visio", "car-visio", "192.168.1.201", "192.168.1.203"),
    ("router", "car-visio", "192.168.1.1", "192.168.1.203"),
    ("router", "dabo-monitor", "192.168.1.1", "192.168.1.202"),
]


@pytest.mark.parametrize(("observer", "target", "source", "hop"), WAYS)
def test_way(observer, target, source, hop):
    fleet = fig12()
    way = Ways(fleet).way(fleet.computers[observer], target)
    assert (str(way.source), str(way.next_hop or "")) == (source, hop)

    def other_source(seen):
        update(of(seen[observer].probe.members, target).route, source="10.9.8.7")

    def other_hop(seen):
        update(of(seen[observer].probe.members, target).route, gateway="10.9.8.1")

    for change in (other_source, other_hop):
        assert [key[:3] for key in notable(evaluate(change, fleet))] == [("route", observer, target)]


def test_existing_routes_may_go_by_the_router():
    fleet = fig12(multimaster_routes="existing")

    def by_router(seen):
        for computer in ("tibi-visio", "tibi-nav"):
            update(of(seen[computer].probe.members, "car-nav").route, gateway="192.168.1.1")

    assert [key[:3] for key in notable(evaluate(by_router, fleet))] == [("route", "tibi-nav", "car-nav")]


def test_a_route_that_only_the_router_misses_is_told_too():
    def change(seen):
        lost_route(seen)
        silent(seen, ["router"], ["tibi-nav"])

    found = [finding for finding in notable(evaluate(change, fig12())).values() if finding.observer == "router"]
    assert [finding.check for finding in found] == ["ping_address"]
    assert "tibi-nav has no way out" in found[0].cause
