# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Checks of discovery: datagrams, ports, clocks and lists of masters, for two robots and between three robot networks."""

import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.checks.engine import FAILED, OK, WARNING
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.diagnose.evidence import INFERRED, SEEN
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observe.observations import (
    FilterChain,
    FilterChains,
    FilterRule,
    GroupMembership,
    MasterList,
    NodeParameters,
    TopicPublisher,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observe.outcomes import Outcome
from fleets import (
    ONE,
    TWO,
    assert_told,
    components,
    diagnosed,
    evaluate,
    fig12,
    notable,
    of,
    plan,
    silent,
    update,
)


def _udp(unicast, **values):
    return lambda seen: update(of(seen[ONE].multicast.udp, TWO), unicast=unicast, **values)


def _master(**values):
    return lambda seen: update(of(seen[ONE].probe.masters, TWO, "computer"), **values)


def _listed(**values):
    return lambda seen: update(of(seen[ONE].probe.list_masters.masters, TWO), **values)


def _unlisted(seen):
    update(seen[ONE].probe.list_masters, masters=seen[ONE].probe.list_masters.masters[:-1])


def _refusing_kernel(seen):
    update(seen[TWO].multicast.send_errors, count=9, last="226.0.0.0:11511: Operation not permitted")
    _udp(True, heard_from=False, source_address=None)(seen)


def _icmp(seen):
    update(seen[ONE].multicast.icmp.rounds[0], answered=())


def _clocks(offset):
    """The clock of the second computer differs by some seconds."""

    def change(seen):
        _master(clock_offset_s=offset)(seen)
        update(of(seen[TWO].probe.masters, ONE, "computer"), clock_offset_s=-offset)

    return change


def _closed(error, outcome):
    """The port of the second robot's discovery node does not open, so its new talker is not known to the first."""

    def change(seen):
        for one in (ONE, TWO) if outcome == Outcome.REFUSED else (ONE,):
            port = of(seen[one].probe.masters, TWO, "computer")
            update(port, open=False, error=error, outcome=outcome, clock_offset_s=None)
        _unheard(seen)

    return change


def _hung(seen):
    """The discovery node of the second robot takes connections and answers none."""
    _master(clock_offset_s=None, clock_error="getCurrentTime failed: timed out")(seen)
    update(seen[TWO].probe, list_masters=MasterList(error="no answer within 10 s"))
    update(seen[TWO].probe.exchange, silent=["/master_discovery"])
    _listed(online=False)(seen)
    _unheard(seen)


def _unheard(seen):
    update(of(seen[ONE].probe.topics, TWO, "computer"), heard=False, publishers=(), error="the topic is not registered")


def _other_group(seen):
    """The discovery node of the second robot uses another group or port: nobody lists the other."""
    _unlisted(seen)
    update(seen[TWO].probe.list_masters, masters=seen[TWO].probe.list_masters.masters[1:])
    for one in (ONE, TWO):  # nodes that somebody started by hand may not have told their roscore
        update(seen[one].probe, parameters=NodeParameters())
    for one, other in ((ONE, TWO), (TWO, ONE)):
        entry = of(seen[one].probe.topics, other, "computer")
        update(entry, heard=False, publishers=(), error="the topic is not registered")


def _stopped(seen):
    """The discovery node of the second robot was stopped a moment ago: what the robots have of each other is still there."""
    for one in (ONE, TWO):
        port = of(seen[one].probe.masters, TWO, "computer")
        refused = {"open": False, "error": "Connection refused", "outcome": Outcome.REFUSED}
        update(port, **refused, clock_offset_s=None, clock_error="no answer")
    update(seen[TWO].probe, list_masters=MasterList(error="ERROR: Unable to communicate with master!"))
    update(of(seen[ONE].probe.topics, TWO, "computer"), publishers=[TopicPublisher("/n", "")])


# The change, a check that tells it, its verdict, and the part that is named.
FAULTS = [
    (_udp(True, heard_from=False, other_interfaces=["eth1"]), "udp_multicast", WARNING, "interface", ONE, "multicast"),
    (_udp(True, source_address="10.0.2.2"), "udp_multicast", FAILED, "translation", TWO, "on"),
    (_icmp, "icmp_rounds", WARNING, "setting", TWO, "icmp_group"),
    (_closed("Connection refused", Outcome.REFUSED), "rpc_port", FAILED, "discovery", TWO, "port"),
    (_closed("no answer within 2 s", Outcome.NO_ANSWER), "rpc_port", FAILED, "filter", TWO, "rpc in"),
    (_stopped, "rpc_port", FAILED, "discovery", TWO, "dead"),
    (_hung, "clock", FAILED, "discovery", TWO, "hung"),
    (_listed(monitoruri="http://10.0.2.2:11611"), "list_masters", FAILED, "translation", TWO, "on"),
    (_listed(uri="http://localhost:11311/"), "list_masters", FAILED, "roscore", TWO, "name"),
]


@pytest.mark.parametrize(("change", "check", "verdict", "kind", "place", "mode"), FAULTS)
def test_each_fault_is_named(change, check, verdict, kind, place, mode):
    assert_told(change, check, verdict, kind, place, mode)


# Between two computers nothing says which of the two it is.
EITHER = [
    (_clocks(0.3), "clock", {("clock", ONE, "off"), ("clock", TWO, "off")}),
    (_clocks(-3600.0), "clock", {("clock", ONE, "off"), ("clock", TWO, "off")}),
    (_other_group, "list_masters", {("discovery", ONE, "group"), ("discovery", TWO, "group")}),
    (_refusing_kernel, "udp_multicast", {("filter", TWO, "group out")}),
    (
        _udp(True, heard_from=False),
        "udp_multicast",
        {("filter", ONE, "group in"), ("filter", TWO, "group out")},
    ),
]


@pytest.mark.parametrize(("change", "check", "either"), EITHER)
def test_what_cannot_be_decided_is_said_to_be_one_of_two(change, check, either):
    (found,) = diagnosed(change).findings
    assert {component[:3] for component in found.candidates} >= either
    assert check in {row.check for row in found.rows}


def test_the_clock_of_one_of_three_is_named():
    def change(seen):
        for one, probe in seen.items():
            for entry in probe.probe.masters:
                if one != entry.computer and TWO in (one, entry.computer):
                    update(entry, clock_offset_s=2.0)

    assert components(diagnosed(change, plan(robots=3))) == [("clock", TWO, "off")]


def test_the_group_that_a_network_does_not_carry_is_told_once():
    def change(seen):
        for one in seen.values():
            for entry in one.multicast.udp:
                update(entry, heard_from=False, heard=0, source_address=None)

    assert components(diagnosed(change, plan(robots=4))) == [("network", "the common network", "multicast")]


@pytest.mark.parametrize(
    ("joined", "kind", "mode"),
    [
        ([GroupMembership("eth0", "239.9.9.9")], "discovery", "group"),
        ([GroupMembership("eth7", "226.0.0.0"), GroupMembership("eth0", "224.0.0.1")], "interface", "multicast"),
    ],
)
def test_a_node_of_another_group_is_named_without_parameters(joined, kind, mode):
    assert_told(
        lambda seen: update(seen[ONE].multicast, memberships=tuple(joined)), "membership", WARNING, kind, ONE, mode
    )


def test_unused_groups_need_no_member():
    for fleet in (plan(multimaster_multicast_group="224.0.0.1"), plan(multimaster_transport="unicast")):
        assert not {row for row in evaluate(fleet=fleet) if row.check == "membership"}


def test_loss_at_one_computer_is_told_once():
    def change(seen):
        for one in seen:
            for entry in seen[one].multicast.udp:
                if TWO in (one, entry.name):
                    update(entry, loss=0.3)

    (found,) = diagnosed(change, plan(robots=4)).findings
    assert found.component[:3] == ("link", TWO, "loss") and found.verdict == WARNING


def _masquerading(seen):
    """tibi-visio translates the addresses of its robot."""
    for computer in ("dabo-visio", "dabo-nav", "car-visio"):
        multicast = seen[computer].multicast
        callers = [entry for entry in multicast.callers if not entry.address.startswith("192.168.11.")]
        update(multicast, callers=callers)


def _masquerading_master(seen):
    """dabo-visio translates the address of dabo-nav, so that its datagrams are not known as its own."""
    for computer in ("tibi-visio", "car-visio"):
        update(of(seen[computer].multicast.udp, "dabo-nav"), unicast=None, own_source_address=None, source_address=None)
        update(of(seen["dabo-nav"].multicast.udp, computer), own_source_address="192.168.1.202", unicast=False)


def _port(seen):
    update(
        of(seen["tibi-nav"].probe.masters, "tibi-visio", "computer"),
        open=False,
        error="Network is unreachable",
        outcome=Outcome.NETWORK_UNREACHABLE,
        clock_offset_s=None,
    )


def _no_local_port(seen):
    """No connection can be made on tibi-nav: nothing else is wrong there."""
    for master in seen["tibi-nav"].probe.masters:
        update(
            master,
            open=False,
            error="Cannot assign requested address",
            outcome=Outcome.NO_LOCAL_PORT,
            clock_offset_s=None,
        )


BETWEEN_NETWORKS = [
    (_no_local_port, "rpc_port", FAILED, "computer", "tibi-nav", "ports"),
    (_masquerading, "source", WARNING, "translation", "tibi-visio", "on"),
    (_masquerading_master, "udp_unicast", FAILED, "translation", "dabo-visio", "on"),
    (_port, "rpc_port", FAILED, "route", "tibi-nav", "missing"),
]


@pytest.mark.parametrize(("change", "check", "verdict", "kind", "place", "mode"), BETWEEN_NETWORKS)
def test_each_fault_between_networks_is_named(change, check, verdict, kind, place, mode):
    assert_told(change, check, verdict, kind, place, mode, fleet=fig12())


@pytest.mark.parametrize(
    ("rule", "unread", "sure"),
    [
        (FilterRule("masquerade", chain="post"), 0, SEEN),
        (FilterRule("masquerade", sources=("192.168.11.0/24",), chain="post"), 0, SEEN),
        (FilterRule("masquerade", sources=("172.17.0.0/16",), chain="post"), 0, INFERRED),  # as Docker's
        (FilterRule("masquerade", chain="post"), 1, INFERRED),
    ],
)
def test_a_rule_that_translates_is_seen(rule, unread, sure):
    def change(seen):
        _masquerading(seen)
        chain = FilterChain("postrouting", "inet own", "accept", (rule,), unread, "post")
        update(seen["tibi-visio"], filters=FilterChains(True, (chain,)))

    (found,) = diagnosed(change, fig12()).findings
    assert (found.component[:3], found.sure) == (("translation", "tibi-visio", "on"), sure)


@pytest.mark.parametrize(
    ("transport", "heard", "unicast", "multicast_verdict", "unicast_verdict"),
    [
        ("both", False, True, WARNING, OK),
        ("both", True, False, OK, WARNING),
        ("both", False, None, FAILED, FAILED),
        ("multicast", False, True, FAILED, OK),
        ("multicast", False, False, FAILED, None),
        ("unicast", False, True, None, OK),
        ("unicast", True, False, None, FAILED),
    ],
)
def test_what_the_transport_needs(transport, heard, unicast, multicast_verdict, unicast_verdict):
    change = _udp(unicast, heard_from=heard, source_address="192.168.1.2" if heard else None)
    findings = evaluate(change, plan(multimaster_transport=transport))
    verdicts = {
        finding.check: finding.verdict for finding in findings if (finding.observer, finding.target) == (ONE, TWO)
    }
    assert (verdicts.get("udp_multicast"), verdicts.get("udp_unicast")) == (multicast_verdict, unicast_verdict)


def test_by_plan_nobody_answers_a_ping_of_the_group():
    findings = evaluate(_icmp, plan(multimaster_answer_broadcast_pings=False))
    assert not notable(findings) and "icmp_rounds" not in {finding.check for finding in findings}


def test_a_refused_port_tells_a_dead_roscore_from_a_hung_one():
    def change(seen):
        update(seen[TWO], unreachable=True, probe=None, multicast=None)
        listed = seen[ONE].probe.list_masters
        update(listed, masters=tuple(entry for entry in listed.masters if TWO not in entry.name))
        update(
            of(seen[ONE].probe.masters, TWO, "computer"), roscore="Connection refused", roscore_outcome=Outcome.REFUSED
        )

    found = diagnosed(change)
    assert ("roscore", TWO, "dead") in components(found) and not any(
        component.mode == "hung" for entry in found.findings for component in entry.candidates
    )


def test_what_comes_in_elsewhere_follows_from_a_lost_link():
    """The interface was taken out of its bridge: the bridge has no link, and the group is heard at the interface below."""

    def change(seen):
        update(seen[ONE].probe.forwarding.interfaces[0], state="down")
        silent(seen, [ONE], [TWO])
        silent(seen, [TWO], [ONE])
        _udp(True, heard_from=False, other_interfaces=["eth7"])(seen)

    assert components(diagnosed(change)) == [("link", ONE, "down")]


def test_a_call_from_another_address_is_closed_and_explained():
    """The planned address is the second one of its interface, so packets leave from the first."""

    def change(seen):
        update(of(seen[ONE].probe.members, TWO).route, source="192.168.1.77")
        _master(clock_offset_s=None, clock_error="getCurrentTime failed: the connection was closed")(seen)

    found = diagnosed(change)
    assert components(found) == [("interface", ONE, "address")] and not found.unexplained
