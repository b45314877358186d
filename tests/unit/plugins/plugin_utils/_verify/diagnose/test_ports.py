# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""A finding about a packet filter has the ports of this fleet, and not the default ones."""

import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.checks.engine import FAILED, Row
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.components.component import Component
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.diagnose.ports import find_port
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observe.observations import (
    FilterChain,
    FilterChains,
    FilterRule,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observe.outcomes import Outcome
from fleets import ONE, TWO, components, diagnose, no_answer, observed, plan, update

PORTS = {"multimaster_multicast_port": 12000, "multimaster_rpc_port": 12611, "multimaster_roscore_port": 12311}


@pytest.mark.parametrize(
    ("kind", "mode", "port"),
    [
        ("filter", "udp in", "12000"),
        ("filter", "udp", "12000"),
        ("filter", "rpc out", "12611"),
        ("filter", "roscore in", "12311"),
        ("filter", "group in", ""),
        ("filter", "all in", ""),
        ("filter", "forward", ""),
        ("sync", "udp in", ""),
    ],
)
def test_the_port_is_that_of_the_plan(kind, mode, port):
    rows = [Row("rpc_port", ONE, TWO, FAILED, "", "")]
    assert find_port(Component(kind, ONE, mode), rows, plan(**PORTS)) == port


@pytest.mark.parametrize("rows", [[], [Row("rpc_port", ONE, "a stranger", FAILED, "", "")]])
def test_without_a_master_no_port_is_told(rows):
    assert find_port(Component("filter", ONE, "rpc in"), rows, plan(**PORTS)) == ""


def test_the_sentence_and_the_command_have_the_port_of_the_fleet():
    fleet = plan(**PORTS)
    seen = observed(fleet)
    update(seen[ONE], filters=FilterChains(True, ()))
    rule = FilterRule("drop", protocol="tcp", ports=(12611, 12611), chain="input")
    update(seen[TWO], filters=FilterChains(True, (FilterChain("input", "inet own", "accept", (rule,), 0),)))
    for entry in seen[ONE].probe.masters:
        if entry.computer == TWO:
            update(entry, open=False, error="timed out", outcome=Outcome.NO_ANSWER)
    found = diagnose(fleet, seen)
    assert components(found) == [("filter", TWO, "rpc in")]
    (entry,) = found.findings
    assert "12611" in entry.sentence() and "11611" not in entry.sentence()
    (command, *_more) = [one.text for one in entry.do]
    assert command.startswith("nft insert rule inet own input") and "tcp dport 12611 accept" in command


def test_a_rule_for_a_size_leaves_the_rule_for_a_port_its_own_finding_and_command():
    fleet = plan()
    seen = observed(fleet)
    update(seen[ONE], filters=FilterChains(True, ()))
    port = FilterRule("drop", protocol="tcp", ports=(11611, 11611), chain="a")
    size = FilterRule("drop", above=1400, chain="b")
    chains = tuple(FilterChain("input", "inet own", "accept", (rule,), 0, rule.chain) for rule in (port, size))
    update(seen[TWO], filters=FilterChains(True, chains))
    for entry in seen[ONE].probe.masters:
        if entry.computer == TWO:
            update(entry, open=False, error="timed out", outcome=Outcome.NO_ANSWER)
    for entry in seen[ONE].probe.members:
        if entry.name == TWO:
            update(entry, ping_large=no_answer())
    found = diagnose(fleet, seen)
    assert {one[2] for one in components(found)} == {"rpc in", "large in"}
    of_port, of_size = sorted(found.findings, key=lambda one: one.component.mode, reverse=True)
    assert "more than 1400 bytes" in of_size.sentence() and "meta length gt 1400 accept" in of_size.do[0].text
    assert " inet own a " in of_port.do[0].text and " inet own b " in of_size.do[0].text
