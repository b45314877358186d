# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Checks of one computer by itself: the parts that are named, for two robots and between three robot networks."""

import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.checks.engine import (
    FAILED,
    UNKNOWN,
    WARNING,
    Verification,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.checks.table import CHECKS
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observe.observations import (
    FilterState,
    MasterList,
    Observation,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observe.outcomes import Outcome
from fleets import (
    COMPANION,
    ONE,
    ROBOTS,
    SEALED,
    TWO,
    assert_told,
    components,
    diagnose,
    diagnosed,
    evaluate,
    fig12,
    good,
    no_answer,
    no_arp,
    notable,
    observed,
    of,
    outside,
    plan,
    sealed,
    second_default_route,
    silent,
    update,
    wall,
    without,
)


def _service(**values):
    return lambda seen: update(of(seen[ONE].probe.services, "roscore"), **values)


def _roscore(**values):
    return lambda seen: update(seen[ONE].probe.roscore, **values)


def _filter(seen):
    update(seen[ONE], packet_filter=FilterState(changed=True, msg="The rules of nftables would be changed."))


def _silent_roscore(error):
    """The roscore of the first robot does not answer; nothing of ROS is left there."""

    def change(seen):
        _roscore(answer="", error=error)(seen)
        update(seen[ONE].probe, list_masters=MasterList(error="ERROR: Unable to communicate with master!"))
        for one, other in ((ONE, TWO), (TWO, ONE)):
            entry = of(seen[one].probe.topics, other, "computer")
            update(entry, heard=False, publishers=(), error="the topic is not registered")
        update(seen[TWO].probe.list_masters.masters[0], online=False)

    return change


def _interface(**values):
    return lambda seen: update(seen[ONE].probe.forwarding.interfaces[0], **values)


def _on_a_port(seen):
    """The address is on a port of a bridge: what comes in belongs to the bridge, and the computer gets no answer."""
    _interface(port_of="br0")(seen)
    silent(seen, [ONE], [TWO])
    silent(seen, [TWO], [ONE])
    update(of(seen[ONE].multicast.udp, TWO), other_interfaces=["br0"])


def _no_link(seen):
    _interface(state="down")(seen)
    silent(seen, [ONE], [TWO])
    silent(seen, [TWO], [ONE])


def _small(seen):
    """The interface has a small MTU, so the other's large packets do not arrive."""
    _interface(mtu=1000)(seen)
    update(of(seen[TWO].probe.members, ONE), ping_large=no_answer())


def _sources(*names):
    return lambda seen: update(seen[ONE].probe, name_sources=names)


def _no_files(seen):
    """Nobody looks into /etc/hosts, and no name server answers."""
    _sources("dns")(seen)
    for member in seen[ONE].probe.members:
        update(member, addresses=(), resolve_error="Temporary failure in name resolution")


def _ignores_pings(seen):
    """The first computer's kernel answers no pings; all else arrives."""
    update(seen[ONE].probe.forwarding, icmp_echo_ignore_all=1)
    update(
        of(seen[TWO].probe.members, ONE),
        ping_address=no_answer(),
        ping_name=no_answer(),
        tcp="refused",
        tcp_outcome=Outcome.REFUSED,
        loss=1.0,
    )


def _ended(seen):
    """The unit of the roscore has failed, and nobody else's roscore answers in its place."""
    _service(active_state="failed", sub_state="failed")(seen)
    update(seen[ONE].probe.roscore, answer="", error="Connection refused", outcome=Outcome.REFUSED)


# The change, a check that tells it, its verdict, and the part that is named.
FAULTS = [
    (_ignores_pings, "answers_pings", WARNING, "setting", ONE, "icmp_all"),
    (_sources("mdns4_minimal", "files", "dns"), "name_order", WARNING, "names", ONE, "order"),
    (_no_files, "name_order", WARNING, "names", ONE, "order"),
    (_on_a_port, "addresses", WARNING, "interface", ONE, "port"),
    (_interface(prefixes=(24,)), "addresses", WARNING, "interface", ONE, "prefix"),
    (_no_link, "addresses", WARNING, "link", ONE, "down"),
    # It has answered in the same run.
    (_interface(state="down"), "addresses", WARNING, "link", ONE, "flapping"),
    (_filter, "packet_filter", FAILED, "filter", ONE, "changed"),
    (
        _service(load_state="not-found", active_state="inactive", sub_state="dead"),
        "services",
        FAILED,
        "service",
        ONE,
        "missing",
    ),
    (_service(active_state="failed", sub_state="failed"), "services", FAILED, "set_up", ONE, "others"),
    (_ended, "services", FAILED, "roscore", ONE, "dead"),
    (_service(restarts=4, age_s=599.0), "services", WARNING, "service", ONE, "restarting"),
    (
        _service(active_state="activating", sub_state="auto-restart", restarts=18),
        "services",
        FAILED,
        "service",
        ONE,
        "looping",
    ),
    (_service(open_files=63, most_files=64), "services", FAILED, "service", ONE, "full"),
    (_service(stopped=True), "services", FAILED, "service", ONE, "stopped"),
    (_service(differing=None), "environment", UNKNOWN, "setting", ONE, "unread"),
    (_service(differing=["ROS_HOSTNAME"]), "environment", FAILED, "environment", ONE, "service"),
    (_roscore(answer="http://localhost:11311/"), "master_uri", FAILED, "roscore", ONE, "name"),
    (_roscore(uri="http://old:11311/"), "master_uri", FAILED, "environment", ONE, "shell"),
    (_silent_roscore("no answer within 5 s"), "master_uri", FAILED, "roscore", ONE, "hung"),
]


@pytest.mark.parametrize(("change", "check", "verdict", "kind", "place", "mode"), FAULTS)
def test_each_fault_is_named(change, check, verdict, kind, place, mode):
    assert_told(change, check, verdict, kind, place, mode)


def _closed_gateway(seen):
    """tibi-visio does not forward."""
    update(seen["tibi-visio"].probe.forwarding, ip_forward=0)
    wall(seen)


def _kernel(computer, **values):
    return lambda seen: update(seen[computer].probe.forwarding.interfaces[0], **values)


def _lost_address(seen):
    interface = seen["tibi-visio"].probe.forwarding.interfaces[0]
    update(interface, addresses=("10.9.8.7",))


BETWEEN_NETWORKS = [
    (_closed_gateway, "forwarding", FAILED, "forwarding", "tibi-visio", "off"),
    (_kernel("router", forwarding=0), "forwarding", FAILED, "forwarding", "router", "off"),
    (_kernel("car-visio", rp_filter=1), "reverse_path", WARNING, "reverse_path", "car-visio", "strict"),
    (_kernel("router", send_redirects=1), "redirects", WARNING, "redirects", "router", "sent"),
    (_lost_address, "addresses", WARNING, "interface", "tibi-visio", "address"),
    (second_default_route, "default_routes", WARNING, "route", "car-ext", "defaults"),
]


@pytest.mark.parametrize(("change", "check", "verdict", "kind", "place", "mode"), BETWEEN_NETWORKS)
def test_each_fault_between_networks_is_named(change, check, verdict, kind, place, mode):
    assert_told(change, check, verdict, kind, place, mode, fleet=fig12())


@pytest.mark.parametrize("names", [(), ("files", "dns"), ("files", "mdns4_minimal", "dns"), ("resolve", "files")])
def test_usual_orders_of_names_are_right(names):
    assert not diagnosed(_sources(*names), plan()).findings


def test_a_small_mtu_is_told_with_the_large_packets_it_costs():
    first, *others = diagnosed(_small, plan(robots=3)).findings
    assert first.component[:3] == ("interface", ONE, "mtu") and first.verdict == WARNING and not others
    assert [row.check for row in first.rows] == ["ping_large"]


def test_a_computer_that_is_down_is_named_once():
    fleet = plan(robots=3)
    seen = observed(fleet)
    seen[TWO] = Observation(unreachable=True, problem="no route to host")
    for name in (ONE, "kobuki3computer"):
        probe, multicast = seen[name].probe, seen[name].multicast
        for ping in (of(probe.members, TWO).ping_address, of(probe.members, TWO).ping_name):
            update(ping, ok=False, error="no answer")
        update(of(probe.members, TWO), loss=1.0)
        update(of(probe.masters, TWO, "computer"), open=False, error="no answer", clock_offset_s=None)
        update(probe.list_masters, masters=without(probe.list_masters.masters, TWO))
        update(probe, topics=without(probe.topics, TWO, "computer"))
        update(of(multicast.udp, TWO), heard_from=False, unicast=None, source_address=None)
    no_arp(seen, TWO)
    found = diagnose(fleet, seen)
    assert components(found) == [("computer", TWO, "off")] and not found.unexplained
    assert "no route to host" in {row.found for row in found.findings[0].rows}
    others = {ONE, "kobuki3computer"}
    assert not any({row.observer, row.target} == others for row in found.findings[0].rows)


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
    assert components(diagnose(fleet, seen)) == [("computer", "car-visio", "off")]


def test_a_computer_without_a_result_is_named():
    fleet = plan()
    seen = {ONE: good(fleet, ONE), TWO: Observation(problem="MODULE FAILURE")}
    found = diagnose(fleet, seen)
    assert components(found) == [("computer", TWO, "unmeasured")]
    assert found.findings[0].proof[0].found == "MODULE FAILURE"


def test_a_second_default_route_is_told_with_its_metric():
    found = diagnosed(second_default_route, fig12()).findings[0]
    assert "metric 100" in found.proof[0].found and any("multimaster_routes" in one.text for one in found.do)


@pytest.mark.parametrize(
    ("age", "since_last", "told"),
    [
        (599.0, 0.0, True),
        (601.0, 0.0, False),
        (599.0, 60.0, True),  # the last verification told it already; it is still new
        (86000.0, 86400.0, True),  # no verification since
        (86500.0, 86400.0, False),
        (None, 86400.0, False),
        (-1e308, 0.0, False),
    ],
)
def test_a_restart_is_told_when_it_is_new(age, since_last, told):
    fleet = plan()
    seen = observed(fleet)
    _service(restarts=3, age_s=age)(seen)
    rows = Verification(CHECKS, fleet, seen, since_last=since_last).rows()
    assert [row.verdict == WARNING for row in rows if (row.check, row.observer) == ("services", ONE)] == [told]


@pytest.mark.parametrize("ages", [(3.0, 170.0), (170.0, 3.0)])
def test_of_two_restarts_the_last_one_stands_first(ages):
    """The other one is of a fault that was there before, and has been mended since."""
    fleet = plan()
    seen = observed(fleet)
    for computer, age in zip((ONE, TWO), ages, strict=True):
        update(of(seen[computer].probe.services, "roscore"), restarts=4, age_s=age)
    told = [entry.component.place for entry in diagnose(fleet, seen).findings]
    assert told == sorted((ONE, TWO), key=lambda name: ages[(ONE, TWO).index(name)])


def test_a_full_process_explains_what_it_does_not_answer():
    def change(seen):
        _service(open_files=1024, most_files=1024)(seen)
        _silent_roscore("no answer within 5 s")(seen)

    assert components(diagnosed(change)) == [("service", ONE, "full")]


@pytest.mark.parametrize(
    ("tcp", "waiting", "expected"),
    [
        (Outcome.NO_ANSWER, 0, ("filter", ONE, "roscore in")),  # dropped before it
        (
            Outcome.NO_ANSWER,
            6,
            ("roscore", ONE, "hung"),
        ),  # nobody takes those that wait, and the kernel lets in no more
        (Outcome.OPEN, 1, ("roscore", ONE, "hung")),
        (Outcome.NO_ANSWER, None, ("roscore", ONE, "hung")),
    ],
)
def test_a_roscore_that_hangs_is_told_from_one_behind_a_filter(tcp, waiting, expected):
    def change(seen):
        _silent_roscore("no answer within 5 s")(seen)
        _roscore(outcome=Outcome.NO_ANSWER, tcp_outcome=tcp, waiting=waiting)(seen)

    assert components(diagnosed(change)) == [expected]


def test_a_service_with_room_for_files_is_well():
    assert not diagnosed(_service(open_files=62, most_files=64)).findings


@pytest.mark.parametrize(
    ("result", "status", "words"),
    [
        ("watchdog", 6, ": the watchdog ended it, since it hung (Result=watchdog)"),
        ("oom-kill", 9, ": the kernel ended it, since memory ran out (Result=oom-kill)"),
        ("signal", 9, ": the signal 9 ended it, which systemd had not sent (Result=signal)"),
        ("exit-code", 1, ": it ended by itself with the status 1 (Result=exit-code)"),
        ("core-dump", None, ": it crashed with the signal ? (Result=core-dump)"),
        ('"made up"', 6, ""),
        ("", None, ""),
    ],
)
def test_a_finding_says_who_ended_a_service_and_why(result, status, words):
    again = _service(restarts=4, age_s=599.0, result=result, status=status)
    found = notable(evaluate(again))[("services", ONE, ONE)]
    assert words in str(found)
    ended = _service(active_state="failed", sub_state="failed", result=result, status=status)
    assert words in str(notable(evaluate(ended))[("services", ONE, ONE)])


def test_a_service_that_preflight_left_out_is_not_missed():
    """The plan of the fleet has it; the kernel of this computer, or its Python, cannot run it."""

    def without_connections(seen):
        probe = seen[ONE].probe
        update(probe, services=without(probe.services, "connections"))

    def left_out(seen):
        without_connections(seen)
        update(seen[ONE], services=tuple(entry.name for entry in seen[ONE].probe.services))

    assert ("services", ONE, ONE) in notable(evaluate(without_connections))
    assert not notable(evaluate(left_out))


# A computer where nobody logs in

NOT_JUDGED = {("sealed", COMPANION, COMPANION): UNKNOWN}


def test_a_sealed_computer_is_not_judged():
    assert {key: row.verdict for key, row in notable(evaluate(fleet=sealed())).items()} == NOT_JUDGED
    assert components(diagnosed(fleet=sealed())) == [("computer", SEALED, "sealed")]


def test_a_sealed_roscore_may_have_each_of_its_names():
    def rename(seen):
        update(seen[COMPANION].probe.roscore, answer="http://hsrb.local:11311/")
        for one in seen.values():
            update(of(one.probe.list_masters.masters, SEALED), uri="http://hsrb.local:11311/")

    assert {key: row.verdict for key, row in notable(evaluate(rename, sealed())).items()} == NOT_JUDGED


def test_a_silent_sealed_roscore_is_named():
    def silence(seen):
        update(seen[COMPANION].probe.roscore, answer="", error="no answer", outcome=Outcome.REFUSED)
        update(seen[COMPANION].probe, list_masters=MasterList(error="ERROR: Unable to communicate with master!"))
        update(of(seen[ONE].probe.list_masters.masters, SEALED), online=False)

    assert ("roscore", SEALED, "sealed") in components(diagnosed(silence, sealed()))


def test_an_address_of_a_vpn_stands_alone():
    def narrow(seen):
        update(seen[ONE].probe.forwarding.interfaces[0], prefixes=(32,))

    def tunnel(seen):
        narrow(seen)
        update(seen[ONE].probe.forwarding.interfaces[0], point_to_point=True)

    assert notable(evaluate(narrow)) and not notable(evaluate(tunnel))


def test_a_router_that_tells_of_ros_costs_nobody_the_report():
    assert not notable(evaluate(lambda seen: update(seen["router"].probe, ros_missing=""), fig12()))


def test_services_of_which_systemd_told_nothing_are_not_said_to_be_down():
    def change(seen):
        update(seen[ONE].probe, services=(), problems=("services could not be looked at: no answer within 60 s.",))

    (finding,) = diagnosed(change).findings
    assert (finding.component.kind, finding.component.mode) == ("computer", "unmeasured")
    assert [row.verdict for row in evaluate(change) if (row.check, row.observer) == ("services", ONE)] == [UNKNOWN]
