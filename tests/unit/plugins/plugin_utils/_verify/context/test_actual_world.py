# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Known faults in the world as it was read: which packets end there."""

from dataclasses import replace

import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.components.component import Component
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.context.actual_world import ActualWorld
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.context.check_context import FleetState
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observe.observations import PolicyRouting
from fleets import fig12, observed, update
from hypothesis import given, settings
from hypothesis import strategies as st

# A gateway and a computer behind it; two of another robot; the second computer of the first one
GATE, INNER, OTHER, OUTER, NEAR = "tibi-visio", "tibi-nav", "car-nav", "car-visio", "tibi-monitor"
TIBI, COMMON = "the network of tibi", "the common network"


def see(*components, interface=None, policy=None, computer=GATE):
    """The world of good observations with these faults, and with changes of an interface or of the policy of a computer."""
    fleet = fig12()
    seen = observed(fleet)
    probe = seen[computer].probe
    if interface:
        number, values = interface
        entries = list(probe.forwarding.interfaces)
        entries[number] = replace(entries[number], **values)
        update(probe.forwarding, interfaces=entries)
    if policy:
        update(probe, policy=policy)
    return ActualWorld(FleetState(fleet, seen, 0.0), components)


CASES = [
    # The fault, what was read on the gateway, a way that ends there, and one that does not
    (Component("link", GATE, "down", COMMON), {"interface": (1, {"state": "down"})}, (OTHER, INNER), (NEAR, INNER)),
    (Component("link", GATE, "down", TIBI), {"interface": (0, {"state": "down"})}, (NEAR, OTHER), (OUTER, OTHER)),
    (
        Component("interface", GATE, "address"),
        {"interface": (1, {"addresses": ("192.168.1.77",)})},
        (OTHER, INNER),
        (NEAR, INNER),
    ),
    (Component("forwarding", GATE, "off"), {"interface": (1, {"forwarding": 0})}, (OTHER, INNER), (OTHER, OUTER)),
    (Component("computer", GATE, "off"), {}, (INNER, OTHER), (INNER, NEAR)),
    (Component("network", TIBI, "dead"), {}, (INNER, NEAR), (OTHER, OUTER)),
    (Component("route", INNER, "missing", COMMON), {}, (OUTER, INNER), (OTHER, INNER)),
    (Component("route", INNER, "missing"), {}, (OTHER, INNER), (NEAR, INNER)),
    (Component("route", GATE, "closed", "blackhole 192.168.12.0/24"), {}, (INNER, OTHER), (INNER, NEAR)),
    (
        Component("route", GATE, "rule"),
        {"policy": PolicyRouting(("99: from all to 192.168.12.0/24 prohibit",))},
        (INNER, OTHER),
        (INNER, NEAR),
    ),
    (Component("neighbour", NEAR, "fixed", GATE), {}, (NEAR, OTHER), (INNER, OTHER)),
]


@pytest.mark.parametrize(("component", "read", "lost", "whole"), CASES, ids=lambda value: str(value)[:40])
def test_packets_end_at_a_known_fault_alone(component, read, lost, whole):
    world = see(component, **read)
    assert world.find_fault(*lost, "icmp") == component
    assert world.find_fault(*lost, "rpc") == component
    assert world.find_fault(*whole, "icmp") is None


def test_what_fails_without_a_known_fault_has_none():
    down = (1, {"state": "down"})
    assert see(interface=down).find_fault(OTHER, INNER, "icmp") is None
    assert see(Component("names", INNER, "unknown", OTHER), interface=down).find_fault(OTHER, INNER, "icmp") is None


def test_a_computer_does_not_reach_itself_by_a_link_that_is_down():
    world = see(Component("link", INNER, "down", TIBI), interface=(0, {"state": "down"}), computer=INNER)
    assert world.find_fault(INNER, INNER, "roscore") == Component("link", INNER, "down", TIBI)


@pytest.mark.parametrize("way", [(OUTER, GATE), (GATE, OUTER), (INNER, OTHER), (OTHER, INNER), (NEAR, INNER)])
def test_one_interface_may_have_the_addresses_of_two_networks(way):
    """Packets of both networks pass it, so they do not end at whatever else is known of its computer."""
    fleet = fig12()
    seen = observed(fleet)
    inner, outer = seen[GATE].probe.forwarding.interfaces
    both = replace(inner, addresses=inner.addresses + outer.addresses, prefixes=inner.prefixes + outer.prefixes)
    update(seen[GATE].probe.forwarding, interfaces=(both,))
    state = FleetState(fleet, seen, 0.0)
    known = Component("reverse_path", GATE, "strict")
    assert ActualWorld(state, [known]).find_fault(*way, "icmp") is None
    off = Component("computer", GATE, "off")
    assert ActualWorld(state, [off]).find_fault(*way, "icmp") == (off if way != (NEAR, INNER) else None)
    dead = Component("network", TIBI, "dead")
    ends_there = way in ((NEAR, INNER), (INNER, OTHER))
    assert not ends_there or ActualWorld(state, [dead]).find_fault(*way, "icmp") == dead
    common = Component("network", COMMON, "dead")
    assert ActualWorld(state, [common]).find_fault(NEAR, INNER, "icmp") is None


TEXT = st.text(st.characters(codec="utf-8"), max_size=12) | st.sampled_from(
    ["0.0.0.0", "192.168.11.101", "::1", "default"]
)


@pytest.mark.slow
@settings(max_examples=60, deadline=None)
@given(st.tuples(TEXT, TEXT), st.tuples(st.integers(-1, 300), st.integers(-1, 300)), TEXT, TEXT)
def test_texts_of_a_computer_never_stop_the_diagnosis(addresses, prefixes, words, line):
    component = Component("route", GATE, "closed", words)
    values = {"addresses": addresses, "prefixes": prefixes, "interface": words}
    world = see(
        component,
        Component("computer", words, "off"),
        interface=(1, values),
        policy=PolicyRouting((f"1: {line}",), (line,)),
    )
    assert world.find_fault(OTHER, INNER, "icmp") in (None, component)
