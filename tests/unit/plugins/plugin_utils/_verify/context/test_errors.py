# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The suspects that an error leaves: each errno and each ICMP error, by whom it was reported."""

import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.components.component import FAULTS
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.context.check_context import (
    CheckContext,
    FleetState,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.context.errors import OWN, find_components
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observe.outcomes import Outcome
from fleets import components, diagnosed, fig12, no_answer, observed, of, update

ONE, OTHER, GATEWAY = "car-nav", "tibi-nav", "tibi-visio"
ITS_NETWORK = "the network of tibi"


def find(outcome, traffic="rpc", ping=None, one=ONE, other=OTHER):
    """The parts that are left between two computers, where the ping between them had this answer."""
    fleet = fig12()
    seen = observed(fleet)
    if ping is not None:
        update(of(seen[one].probe.members, other), ping_address=ping)
    state = FleetState(fleet, seen)
    return find_components(CheckContext(state, state.run[one], other), outcome, traffic)


def places(found):
    return {place for component in found for place in component.places}


@pytest.mark.parametrize(
    ("outcome", "kinds"),
    [
        (Outcome.NO_LOCAL_PORT, {("computer", "ports")}),
        (Outcome.NO_FILE, {("computer", "limit")}),
        (Outcome.NO_FILE_HERE, {("computer", "limit")}),
        (Outcome.NO_MEMORY, {("computer", "limit")}),
        (Outcome.NOT_PERMITTED, {("filter", mode) for mode in ("rpc out", "rpc", "all out", "all")}),
        (Outcome.CLOSED_ROUTE, {("route", "closed"), ("route", "rule")}),
    ],
)
def test_an_errno_of_the_sender_speaks_of_the_sender(outcome, kinds):
    found = find(outcome)
    assert places(found) == {ONE} and {(component.kind, component.mode) for component in found} == kinds


def test_each_row_is_a_component_of_the_table():
    for traffic in ("icmp", "udp", "group", "rpc", "roscore", "nodes"):
        assert {(kind, mode.format(traffic)) for rows in OWN.values() for kind, mode, _what in rows} <= FAULTS.keys()


@pytest.mark.parametrize("outcome", [Outcome.OPEN, Outcome.NO_ANSWER, Outcome.FAILED, Outcome.NOT_TRIED])
def test_what_says_nothing_leaves_all_suspects(outcome):
    assert not find(outcome)


def test_a_silent_neighbour_is_told_from_that_of_a_gateway():
    """Host unreachable: of oneself it is the next hop of the sender, of a gateway that of the gateway."""
    ping = no_answer("host unreachable", Outcome.HOST_UNREACHABLE, "192.168.12.100")
    own = find(Outcome.HOST_UNREACHABLE, ping=ping)
    assert places(own) == {ONE, "car-visio", "the network of car"}
    ping = no_answer("host unreachable", Outcome.HOST_UNREACHABLE, "192.168.1.201")
    assert places(find(Outcome.HOST_UNREACHABLE, ping=ping)) == {GATEWAY, OTHER, ITS_NETWORK}


def test_no_route_is_told_from_no_route_of_a_gateway():
    own = find(Outcome.NETWORK_UNREACHABLE, ping=no_answer("x", Outcome.NETWORK_UNREACHABLE))
    assert places(own) == {ONE} and ("route", "missing") in {(component.kind, component.mode) for component in own}
    ping = no_answer("x", Outcome.NETWORK_UNREACHABLE, "192.168.1.201")
    (component,) = find(Outcome.NETWORK_UNREACHABLE, ping=ping)
    assert (component.kind, component.place, component.mode, component.what) == (
        "route",
        GATEWAY,
        "missing",
        ITS_NETWORK,
    )


def test_an_error_of_one_kind_of_packet_is_of_a_filter():
    """Pings are answered, and a connection is not: firewalld reports "host unreachable", too."""
    found = find(Outcome.HOST_UNREACHABLE)
    assert {component.kind for component in found} == {"filter"} and {ONE, OTHER, GATEWAY} <= places(found)


@pytest.mark.parametrize(("traffic", "kind"), [("rpc", "discovery"), ("roscore", "roscore")])
def test_a_refusal_is_of_a_listener_or_of_a_filter(traffic, kind):
    found = {
        (component.kind, component.mode) for component in find(Outcome.REFUSED, traffic, one="tibi-nav", other=GATEWAY)
    }
    assert {(kind, "dead"), ("filter", f"{traffic} in"), ("interface", "duplicate")} <= found
    assert ("link", "down") not in found


def test_a_prohibition_explains_a_host_that_is_unreachable():
    """TCP has no errno of its own for it."""
    found = find(Outcome.HOST_UNREACHABLE, ping=no_answer("x", Outcome.PROHIBITED, "192.168.1.201"))
    assert {component.kind for component in found} == {"filter"}


def test_a_connection_that_ends_is_of_a_program_or_a_filter():
    found = {(component.kind, component.mode) for component in find(Outcome.RESET)}
    assert {("discovery", "hung"), ("filter", "rpc in")} <= found and ("link", "down") not in found


def test_a_refusal_of_oneself_is_of_a_listener():
    assert [
        (component.kind, component.mode) for component in find(Outcome.REFUSED, "roscore", one=GATEWAY, other=GATEWAY)
    ] == [("roscore", "dead")]


def test_an_unknown_reporter_leaves_all_suspects():
    ping = no_answer("x", Outcome.HOST_UNREACHABLE, "203.0.113.7")
    assert not find(Outcome.HOST_UNREACHABLE, ping=ping)


def test_a_packet_filter_of_the_sender_is_the_finding():
    def change(seen):
        for member in seen[ONE].probe.members:
            if member.ping_address is not None:
                lost = no_answer("Operation not permitted", Outcome.NOT_PERMITTED)
                update(member, ping_address=lost, ping_name=lost, ping_large=None, loss=1.0)

    assert components(diagnosed(change, fig12()))[0][:2] == ("filter", ONE)
