# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The packet filters on the ways of the plan, by the rules that were read."""

from dataclasses import replace

import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.components.component import (
    FOLLOWS,
    Component,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.context.packet_filters import ReadFilters
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observe.observations import (
    FilterChain,
    FilterChains,
    FilterRule,
)
from fleets import components, diagnose, fig12, no_answer, observed, update

GATE, INNER, OTHER = "tibi-visio", "tibi-nav", "car-nav"  # a gateway, a computer behind it, and one of another robot
NODES = (32768, 60999)


def drop(**fields):
    return FilterRule("drop", **fields)


def chain(hook, *rules, policy="accept", unread=0):
    return FilterChain(hook, "inet others", policy, rules, unread)


def read(fleet, **chains):
    """Good observations, in which these computers have one chain, and the others none."""
    seen = observed(fleet)
    for name in seen:
        there = chains.get(name.replace("-", "_"))
        update(seen[name], filters=FilterChains(True, (there,) if there else ()))
    return seen


def address(fleet, name):
    return str(next(member.address for member in fleet.members if member.name == name))


CASES = [
    ({"tibi_visio": chain("forward", policy="drop")}, OTHER, INNER, "icmp", Component("filter", GATE, "forward")),
    (
        {"tibi_visio": chain("forward", drop(protocol="tcp"))},
        OTHER,
        INNER,
        "nodes",
        Component("filter", GATE, "forward", "TCP"),
    ),
    ({"tibi_visio": chain("forward", drop(protocol="tcp"))}, OTHER, INNER, "icmp", None),
    # Whoever is behind the gateway begins; the answers are let in.
    (
        {"tibi_visio": chain("forward", FilterRule("accept", state="answer"), drop(incoming="eth1"))},
        INNER,
        OTHER,
        "icmp",
        None,
    ),
    (
        {"tibi_visio": chain("forward", FilterRule("accept", state="answer"), drop(leaving="eth0"))},
        OTHER,
        INNER,
        "icmp",
        Component("filter", GATE, "forward"),
    ),
    (
        {"tibi_nav": chain("input", drop(protocol="tcp", ports=NODES))},
        OTHER,
        INNER,
        "nodes",
        Component("filter", INNER, "nodes in"),
    ),
    ({"tibi_nav": chain("input", drop(protocol="tcp", ports=NODES))}, OTHER, INNER, "icmp", None),
    ({"tibi_nav": chain("output", drop(protocol="icmp"))}, OTHER, INNER, "icmp", Component("filter", INNER, "icmp")),
    (
        {"tibi_nav": chain("output", drop(protocol="icmp"))},
        INNER,
        OTHER,
        "icmp",
        Component("filter", INNER, "icmp out"),
    ),
    (
        {"tibi_visio": chain("input", drop(protocol="udp", ports=(11511, 11511)))},
        "car-visio",
        GATE,
        "udp",
        Component("filter", GATE, "udp in"),
    ),
    (
        {"tibi_visio": chain("input", drop(protocol="udp", ports=(11511, 11511)))},
        "car-visio",
        GATE,
        "group",
        Component("filter", GATE, "udp in"),
    ),
    (
        {"tibi_visio": chain("output", drop(destinations=("224.0.0.0/4",)))},
        GATE,
        "car-visio",
        "group",
        Component("filter", GATE, "group out"),
    ),
    # All that nothing lets in.
    (
        {"tibi_visio": chain("input", FilterRule("accept", protocol="icmp"), policy="drop")},
        "car-visio",
        GATE,
        "nodes",
        Component("filter", GATE, "all in"),
    ),
    (
        {"tibi_visio": chain("input", FilterRule("accept", protocol="icmp"), policy="drop")},
        "car-visio",
        GATE,
        "group",
        Component("filter", GATE, "all in"),
    ),
    (
        {"tibi_visio": chain("input", FilterRule("accept", protocol="icmp"), policy="drop")},
        "car-visio",
        GATE,
        "icmp",
        None,
    ),
    # Large pings, and a rule for large packets
    (
        {"tibi_nav": chain("output", drop(above=800))},
        INNER,
        OTHER,
        "large",
        Component("filter", INNER, "large out", "800"),
    ),
    ({"tibi_nav": chain("output", drop(above=800))}, INNER, OTHER, "icmp", None),
    ({"tibi_nav": chain("output", drop(above=1500))}, INNER, OTHER, "large", None),
    (
        {"tibi_nav": chain("input", drop(protocol="icmp", above=800))},
        OTHER,
        INNER,
        "large",
        Component("filter", INNER, "large in", "800"),
    ),
    (
        {"tibi_nav": chain("output", drop(above=800))},
        OTHER,
        INNER,
        "large",
        Component("filter", INNER, "large", "800"),
    ),
    ({"tibi_nav": chain("input", drop(protocol="icmp"))}, OTHER, INNER, "large", Component("filter", INNER, "icmp in")),
    (
        {"tibi_visio": chain("forward", drop(above=800))},
        OTHER,
        INNER,
        "large",
        Component("filter", GATE, "forward", "packets of more than 800 bytes"),
    ),
    # A rule that is not understood may let it pass before.
    ({"tibi_nav": chain("input", drop(protocol="icmp"), unread=1)}, OTHER, INNER, "icmp", None),
    # What makes no sense is left out.
    ({"tibi_nav": chain("input", drop(sources=("nowhere",)))}, OTHER, INNER, "icmp", None),
    ({"tibi_nav": chain("sideways", drop())}, OTHER, INNER, "icmp", None),
    ({}, OTHER, "nobody", "icmp", None),
]


@pytest.mark.parametrize(("chains", "sender", "target", "traffic", "expected"), CASES)
def test_the_rule_that_drops_a_packet_is_found(chains, sender, target, traffic, expected):
    fleet = fig12()
    assert ReadFilters(fleet, read(fleet, **chains)).find_drop(sender, target, traffic) == expected


def test_a_rule_of_two_computers_is_told_as_one():
    fleet = fig12()
    rule = drop(sources=(f"{address(fleet, OTHER)}/32",), destinations=(f"{address(fleet, INNER)}/32",))
    found = ReadFilters(fleet, read(fleet, tibi_visio=chain("forward", rule)))
    assert found.find_drop(OTHER, INNER, "icmp") == Component.from_pair("filter", "pair", OTHER, INNER)
    assert found.find_drop("car-visio", INNER, "icmp") is None


def test_rules_are_found_behind_an_interface_of_two_networks():
    """Packets through a gateway with one interface for both are followed on either side."""
    fleet = fig12()
    seen = read(fleet, tibi_nav=chain("input", drop(protocol="icmp")))
    inner, outer = seen[GATE].probe.forwarding.interfaces
    addresses, prefixes = inner.addresses + outer.addresses, inner.prefixes + outer.prefixes
    both = replace(inner, interface="wlan0", addresses=addresses, prefixes=prefixes)
    update(seen[GATE].probe.forwarding, interfaces=(both,))
    assert ReadFilters(fleet, seen).find_drop(OTHER, INNER, "icmp") == Component("filter", INNER, "icmp in")


@pytest.mark.parametrize(
    ("chains", "mode", "expected"),
    [
        ({}, "nodes in", True),
        ({"tibi_nav": chain("input", drop(protocol="icmp"))}, "nodes in", True),
        ({"tibi_nav": chain("input", unread=1)}, "nodes in", False),
        ({"tibi_nav": chain("input", unread=1)}, "nodes out", True),
        ({"tibi_nav": chain("output", unread=1)}, "nodes", False),
        ({"tibi_nav": chain("forward", unread=1)}, "forward", False),
    ],
)
def test_rules_that_were_read_speak_against_a_filter(chains, mode, expected):
    fleet = fig12()
    seen = read(fleet, **chains)
    assert ReadFilters(fleet, seen).lets_pass(Component("filter", INNER, mode)) is expected
    update(seen[INNER], filters=FilterChains())
    assert not ReadFilters(fleet, seen).lets_pass(Component("filter", INNER, mode))


def test_a_gateway_that_lets_in_only_answers_is_one_finding():
    """As a router of a home does it: those behind it reach all others, and nobody begins anything with them."""
    fleet = fig12()
    answers = chain("forward", FilterRule("accept", state="answer"), drop(leaving="eth0"))
    seen = read(fleet, tibi_visio=answers)
    for name in seen:
        entry = next((one for one in seen[name].probe.members if one.name == INNER), None)
        if entry and not name.startswith("tibi") and entry.ping_address:
            update(entry, ping_address=no_answer(), ping_name=no_answer() if entry.ping_name else None, loss=1.0)
            for heard in seen[name].probe.topics:
                if heard.computer == INNER:
                    update(heard, heard=False, error="timed out")
    found = diagnose(fleet, seen)
    assert components(found) == [("filter", GATE, "forward")] and not found.unexplained


def test_nothing_follows_from_itself():
    for component in FOLLOWS:
        seen, rest = set(), [component]
        while rest:
            reasons = FOLLOWS.get(rest.pop(), ())
            assert component not in reasons
            rest += [reason for reason in reasons if reason not in seen]
            seen.update(reasons)
