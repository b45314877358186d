# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Checks of discovery: datagrams, ports, clocks and lists of masters, for two robots and between three robot networks."""

import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.checks import discovery
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.engine import FAILED, OK, WARNING
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observations import ListMasters
from fleets import (
    INNER_TIBI,
    ONE,
    TWO,
    assert_told,
    assert_told_between_networks,
    evaluate,
    notable,
    of,
    plan,
    untold,
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


def _no_list(seen):
    update(seen[ONE].probe, list_masters=ListMasters(error="ERROR: Service is not available."))


def _refusing_kernel(seen):
    update(seen[TWO].multicast.send_errors, count=9, last="226.0.0.0:11511: Operation not permitted")
    _udp(True, heard_from=False, source_address=None)(seen)


def _lossy(seen):
    update(of(seen[TWO].multicast.udp, ONE), loss=0.3)  # TWO counts what ONE has heard of it


def _icmp(seen):
    update(seen[ONE].multicast.icmp.rounds[0], answered=())


CAUSES = [
    (_udp(True, heard_from=False), "udp_multicast", WARNING, "IGMP snooping"),
    (_udp(True, heard_from=False, other_interfaces=["eth1"]), "udp_multicast", WARNING, "another interface"),
    (_udp(True, source_address="10.0.2.2"), "udp_multicast", FAILED, "NAT"),
    (_refusing_kernel, "udp_multicast", WARNING, "refuses to send"),
    (_lossy, "udp_multicast", WARNING, "wireless"),
    (_udp(False), "udp_unicast", WARNING, "firewall"),
    (_icmp, "icmp_rounds", WARNING, "does not depend on it"),
    (
        _master(open=False, error="Connection refused", clock_offset_s=None),
        "rpc_port",
        FAILED,
        "no discovery node listens",
    ),
    (_master(open=False, error="no answer within 2 s", clock_offset_s=None), "rpc_port", FAILED, "firewall drops TCP"),
    (
        _master(clock_offset_s=None, clock_error="getCurrentTime failed"),
        "clock",
        FAILED,
        "no discovery node that answers",
    ),
    (_master(clock_offset_s=0.3), "clock", WARNING, "chrony"),
    (_master(clock_offset_s=-3600.0), "clock", FAILED, "chrony"),
    (_no_list, "list_masters", FAILED, "cannot be called"),
    (_listed(online=False), "list_masters", FAILED, "no longer hears"),
    (_listed(monitoruri="http://10.0.2.2:11611"), "list_masters", FAILED, "NAT"),
    (_listed(uri="http://localhost:11311/"), "list_masters", FAILED, "calls itself otherwise"),
    (_unlisted, "list_masters", FAILED, "heartbeats"),
]


@pytest.mark.parametrize(("change", "check", "verdict", "part"), CAUSES)
def test_each_cause_is_told(change, check, verdict, part):
    assert_told(change, check, verdict, part)


def _masquerading(seen):
    """tibi-visio translates the addresses of its robot."""
    for computer in ("dabo-visio", "dabo-nav", "car-visio"):
        multicast = seen[computer].multicast
        callers = [entry for entry in multicast.callers if not entry.address.startswith("192.168.11.")]
        update(multicast, callers=callers)


def _strange_gateway(seen):
    """Somebody on the common network translates the address of dabo-visio for car-visio."""
    multicast = seen["car-visio"].multicast
    update(multicast, callers=[entry for entry in multicast.callers if entry.address != "192.168.1.202"])


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
        clock_offset_s=None,
    )


# The change, the only check that fails by itself, its verdict, the predicate that tells it, whom and a part of the texts.
BETWEEN_NETWORKS = [
    (_masquerading, "source", WARNING, discovery._leaves_by_gateway, set(INNER_TIBI), "tibi-visio translates"),
    (_masquerading_master, "udp_unicast", FAILED, discovery._translated_here, None, "masquerade"),
    (_strange_gateway, "source", WARNING, None, {"dabo-visio"}, "NAT"),
    (_port, "rpc_port", FAILED, discovery._unreachable, {"tibi-nav"}, "common network"),
]


@pytest.mark.parametrize(("change", "check", "verdict", "when", "observers", "part"), BETWEEN_NETWORKS)
def test_each_cause_between_networks_is_told(change, check, verdict, when, observers, part):
    assert_told_between_networks(change, check, verdict, when, observers, part)


def test_every_cause_has_a_row():
    elsewhere = [("udp_multicast", None), ("icmp_rounds", None), ("list_masters", None)]  # the defaults
    assert untold(discovery.CHECKS, CAUSES, BETWEEN_NETWORKS, elsewhere) == []


@pytest.mark.parametrize(
    ("transport", "heard", "unicast", "multicast_verdict", "unicast_verdict"),
    [
        ("both", False, True, WARNING, OK),
        ("both", True, False, OK, WARNING),
        ("both", False, None, FAILED, FAILED),
        ("multicast", False, True, FAILED, None),
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
