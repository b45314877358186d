# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Checks of the network between two computers: names, routes, pings, for two robots and between three robot networks."""

from dataclasses import replace

import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.checks.engine import FAILED, OK, WARNING
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.components.component import Component
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.context.ways import Ways
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observe.observations import (
    Claim,
    FilterChains,
    MasterList,
    Observation,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observe.outcomes import Outcome
from fleets import (
    INNER_CAR,
    INNER_TIBI,
    ONE,
    TWO,
    assert_told,
    components,
    diagnosed,
    evaluate,
    fig12,
    lost_route,
    mac,
    no_answer,
    no_arp,
    notable,
    of,
    outside,
    plan,
    second_default_route,
    silent,
    update,
    wall,
    without,
)


def _name(addresses, error=""):
    return lambda seen: update(of(seen[ONE].probe.members, TWO), addresses=addresses, resolve_error=error)


def _member(component, **values):
    return lambda seen: update(getattr(of(seen[ONE].probe.members, TWO), component), **values)


def _closed(seen):
    """/etc/hosts is for root alone."""
    for entry in seen[ONE].probe.members:
        update(entry, user_addresses=())


def _loses(seen):
    """Every ping between the two is answered, and a third of those that follow is not."""
    for one, other in ((ONE, TWO), (TWO, ONE)):
        update(of(seen[one].probe.members, other), loss=0.35)
        update(of(seen[one].multicast.udp, other), loss=0.3)


def test_a_file_for_root_alone_is_named_once_for_all_names():
    (found,) = diagnosed(_closed).findings
    assert found.component[:3] == ("names", ONE, "rights")


def test_lost_pings_are_a_loss():
    (found,) = diagnosed(_loses).findings
    assert found.verdict == WARNING and {component.mode for component in found.candidates} == {"loss"}


@pytest.mark.parametrize(
    ("tcp", "expected"), [(Outcome.REFUSED, ("filter", "icmp")), (Outcome.NO_ANSWER, ("computer", "off"))]
)
def test_a_refused_connection_shows_a_computer_without_pings(tcp, expected):
    """tibi-monitor is no master, so no port of it is asked otherwise; nobody of the run could look at it."""

    def change(seen):
        for name, one in seen.items():
            for entry in one.probe.members if one.probe else ():
                if entry.name == INNER_TIBI[-1] != name:
                    update(entry, ping_address=no_answer(), ping_name=no_answer(), ping_large=None, loss=1.0)
                    update(entry, tcp=tcp.value, tcp_outcome=tcp)
            topics = one.probe.topics if one.probe else ()
            update(one.probe or one, **({"topics": without(topics, INNER_TIBI[-1], "computer")} if topics else {}))
        if tcp != Outcome.REFUSED:
            no_arp(seen, INNER_TIBI[-1])
        update(seen[INNER_TIBI[-1]], unreachable=True, probe=None, multicast=None)

    found = diagnosed(change, fig12())
    kinds = {(component.kind, component.mode.split()[0]) for entry in found.findings for component in entry.candidates}
    assert expected in kinds and (("computer", "off") in kinds) == (tcp != Outcome.REFUSED), found.findings


def _small(seen):
    """The first computer sends what is for its own network to a gateway: its network is too small."""
    update(of(seen[ONE].probe.members, TWO).route, gateway="192.168.1.254")


def _no_icmp(seen):
    """The second computer drops ICMP that comes in; all else arrives."""
    update(of(seen[ONE].probe.members, TWO), ping_address=no_answer(), ping_name=no_answer(), loss=1.0)


def _another_has_it(seen):
    """Another computer has the address of the second one, too."""
    update(of(seen[ONE].probe.members, TWO), neighbour="02:ff:ff:ff:ff:ff")


def _fixed(seen):
    """The network card of the second computer was replaced, and the first one has the old address written down."""
    update(of(seen[ONE].probe.members, TWO), neighbour="02:00:00:00:00:77", neighbour_fixed=True)


def _arp_filter(seen):
    """The first computer asks nobody for hardware addresses, and knows those that have asked it."""
    update(seen[ONE], filters=FilterChains(True, (), ("arp fault",)))


def _large_lost(seen):
    """The network loses large packets, in both directions."""
    for one, other in ((ONE, TWO), (TWO, ONE)):
        update(of(seen[one].probe.members, other), ping_large=no_answer())


# The change, a check that tells it, its verdict, and the part that is named.
FAULTS = [
    (_name([], "Name or service not known"), "name", FAILED, "names", ONE, "unknown"),
    (_name(["127.0.1.1"]), "name", FAILED, "names", ONE, "loopback"),
    (_name(["no address at all"]), "name", FAILED, "names", ONE, "old"),
    (_name(["192.168.1.2", "192.168.7.7"]), "name", FAILED, "names", ONE, "several"),
    (_name(["192.168.7.7"]), "name", FAILED, "names", ONE, "old"),
    (_member("route", source="10.0.0.7"), "route", FAILED, "interface", ONE, "address"),
    (_member("route", device="tun0", source="10.8.0.6"), "route", FAILED, "route", ONE, "other"),
    (_member("route", error="Network is unreachable"), "route", FAILED, "link", ONE, "down"),
    (_small, "route", FAILED, "interface", ONE, "prefix"),
    (_another_has_it, "neighbour", WARNING, "interface", TWO, "duplicate"),
    (_fixed, "neighbour", WARNING, "neighbour", ONE, "fixed"),
    (_arp_filter, "arp_filter", FAILED, "neighbour", ONE, "filter"),
    (_large_lost, "ping_large", WARNING, "network", "the common network", "large"),
    (_no_icmp, "ping_address", FAILED, "filter", TWO, "icmp in"),
]


def _twin_answers(seen):
    """Somebody else has the address of TWO, and chance gives his to nobody yet."""
    update(seen[ONE].probe, claims=(Claim("192.168.1.2", "eth0", (mac(TWO), "02:00:00:00:00:77")),))


FAULTS.append((_twin_answers, "address_once", FAILED, "interface", TWO, "duplicate"))


@pytest.mark.parametrize(("change", "check", "verdict", "kind", "place", "mode"), FAULTS)
def test_each_fault_is_named(change, check, verdict, kind, place, mode):
    assert_told(change, check, verdict, kind, place, mode)


def _gateway_off(seen):
    """car-visio has lost its inner interface: its robot no longer reaches it, nor anybody else."""
    silent(seen, INNER_CAR, ["car-visio", *outside("car")])
    silent(seen, [*outside("car"), "car-visio", "router"], INNER_CAR)
    for name in INNER_CAR:
        probe = seen[name].probe
        update(probe.roscore, answer="", error="no answer within 5 s")
        update(probe, list_masters=MasterList(error="ERROR: Unable to communicate with master!"))
        for one in seen.values():
            for entry in one.probe.topics:
                if entry.computer == name or one is seen[name]:
                    update(entry, heard=False, publishers=(), error="not registered")


def _isolated(seen):
    """The access point of car keeps its clients apart, the gateway among them."""
    _gateway_off(seen)
    silent(seen, INNER_CAR, INNER_CAR)


def _off(seen):
    """tibi-nav is off the network, though the controller reaches it."""
    everybody = [name for name in seen if name != "tibi-nav"]
    silent(seen, everybody, ["tibi-nav"])
    silent(seen, ["tibi-nav"], [name for name in everybody if name != "router"])
    update(seen["tibi-nav"].probe.roscore, answer="", error="no answer within 5 s")
    update(seen["tibi-nav"].probe, list_masters=MasterList(error="ERROR: Unable to communicate with master!"))
    for one in seen.values():
        for entry in one.probe.topics:
            if entry.computer == "tibi-nav" or one is seen["tibi-nav"]:
                update(entry, heard=False, publishers=(), error="not registered")


def _refused(error, outcome):
    def change(seen):
        wall(seen)
        for name in [*outside("tibi"), "router"]:
            for target in INNER_TIBI:
                update(
                    of(seen[name].probe.members, target),
                    ping_address=no_answer(error, outcome, "192.168.1.201"),
                    ping_name=no_answer(error, outcome, "192.168.1.201"),
                    loss=1.0,
                )

    return change


BETWEEN_NETWORKS = [
    (lost_route, "route", FAILED, "route", "tibi-nav", "missing"),
    (wall, "ping_address", FAILED, "filter", "tibi-visio", "forward"),
    (_gateway_off, "ping_address", FAILED, "link", "car-visio", "down"),
    (_isolated, "ping_address", FAILED, "network", "the network of car", "dead"),
    (_off, "ping_address", FAILED, "link", "tibi-nav", "down"),
    (
        _refused("communication administratively prohibited", Outcome.PROHIBITED),
        "ping_address",
        FAILED,
        "filter",
        "tibi-visio",
        "forward",
    ),
    (
        _refused("time to live exceeded", Outcome.TIME_EXCEEDED),
        "ping_address",
        FAILED,
        "route",
        "tibi-visio",
        "circle",
    ),
    (second_default_route, "route", FAILED, "route", "car-ext", "defaults"),
]


@pytest.mark.slow
@pytest.mark.parametrize(("change", "check", "verdict", "kind", "place", "mode"), BETWEEN_NETWORKS)
def test_each_fault_between_networks_is_named(change, check, verdict, kind, place, mode):
    assert_told(change, check, verdict, kind, place, mode, fleet=fig12())


@pytest.mark.parametrize(
    ("macs", "twice"),
    [
        ((), False),
        (("02:00:00:00:00:77",), True),  # of the own address nobody else is to answer
        ((mac(ONE),), False),  # its other interface in the same network
    ],
)
def test_who_answers_for_the_own_address(macs, twice):
    def change(seen):
        update(seen[ONE].probe, claims=(Claim("192.168.1.1", "eth0", macs),))

    assert components(diagnosed(change)) == ([("interface", ONE, "duplicate")] if twice else [])


def test_an_interface_without_an_address_is_no_other_computer():
    """The interface below a macvlan answers for the address above it, and neighbours may send to either."""

    def change(seen):
        below = "02:00:00:00:00:77"
        update(seen[TWO].probe.forwarding, macs=(mac(TWO), below))
        update(seen[ONE].probe, claims=(Claim("192.168.1.2", "eth0", (mac(TWO), below)),))
        update(of(seen[ONE].probe.members, TWO), neighbour=below)

    assert not diagnosed(change).findings


@pytest.mark.parametrize(
    ("macs", "twice"), [(("02:00:00:00:00:77",), False), (("02:00:00:00:00:77", "02:00:00:00:00:78"), True)]
)
def test_of_a_computer_that_nobody_looked_at_two_have_to_answer(macs, twice):
    fleet = plan(robots=3)

    def change(seen):
        seen[TWO] = Observation(problem="it was not looked at")
        update(seen[ONE].probe, claims=(Claim("192.168.1.2", "eth0", macs),))

    assert (("interface", TWO, "duplicate") in components(diagnosed(change, fleet))) == twice


@pytest.mark.parametrize("silence", [False, True])
def test_a_computer_that_is_off_is_no_gateway_that_drops(silence):
    """From the outside, behind a gateway that nobody looked at."""
    fleet = fig12()

    def change(seen):
        others = [*outside("tibi"), "router"]
        silent(seen, others, INNER_TIBI)
        for observer in others:
            for target in INNER_TIBI:
                update(of(seen[observer].probe.members, target), silent=silence)
        for name in set(seen) - set(others):
            del seen[name]

    first = diagnosed(change, fleet).findings[0]
    kinds = {(component.kind, component.mode) for component in first.candidates}
    assert ("forwarding", "off") in kinds and (("link", "down") in kinds) == (not silence)


@pytest.mark.parametrize(("hop", "mode"), [("192.168.11.254", "other"), (None, "missing")])
def test_a_route_to_the_other_address_of_a_gateway(hop, mode):
    def change(seen):
        route = of(seen["tibi-nav"].probe.members, "dabo-visio").discovery_route
        update(route, gateway=hop, error="" if hop else "Network is unreachable")

    first = diagnosed(change, fig12()).findings[0]
    assert (
        first.component == Component("route", "tibi-nav", mode, "the common network")
        and first.proof[0].check == "outer_route"
    )


def test_lost_pings_of_both_sizes_say_nothing_of_the_size():
    def change(seen):
        for one, other in ((ONE, TWO), (TWO, ONE)):
            update(of(seen[one].probe.members, other), ping_large=no_answer(), loss=0.4)

    assert {component.mode for entry in diagnosed(change).findings for component in entry.candidates} == {"loss"}


def test_who_answers_some_pings_drops_none():
    def change(seen):
        for one, other in ((ONE, TWO), (TWO, ONE)):
            update(of(seen[one].probe.members, other), ping_address=no_answer(), ping_name=no_answer(), loss=0.8)

    assert {component.mode for entry in diagnosed(change).findings for component in entry.candidates} == {"loss"}


def test_a_single_ping_that_fails_alone_is_not_explained():
    found = diagnosed(
        lambda seen: update(of(seen["car-nav"].probe.members, "tibi-nav"), ping_address=no_answer(), loss=1.0), fig12()
    )
    assert not found.findings
    assert [row[:3] for row in found.unexplained] == [("ping_address", "car-nav", "tibi-nav")]


def test_a_device_of_another_make_is_named_by_its_address():
    """The gateway of tibi is a device of another make, which nobody asked."""
    fleet = fig12()
    update(fleet.computers["tibi-visio"], is_gateway=False, common_address=None, is_master=True)
    update(of(fleet.members, "tibi-visio"), multicast=False)

    def change(seen):
        tibi = [*INNER_TIBI, "tibi-visio"]
        silent(seen, tibi, outside("tibi"))
        silent(seen, [*outside("tibi"), "router"], tibi)

    first, *_others = diagnosed(change, fleet).findings
    assert {component.place for component in first.candidates} == {"192.168.11.101"}
    assert {component.kind for component in first.candidates} >= {"computer", "forwarding"}


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
    found = diagnosed(lost_route, fig12())
    assert components(found) == [("route", "tibi-nav", "missing")]
    assert ("ping_address", "router", "tibi-nav") in {row[:3] for row in found.findings[0].rows}


def test_a_strange_member_costs_nobody_the_report():
    def change(seen):
        members = seen["tibi-nav"].probe.members
        for target in INNER_CAR:
            update(of(members, target).route, error="Network is unreachable")
        update(seen["tibi-nav"].probe, members=(*members, replace(of(members, INNER_CAR[0]), name="stranger")))

    assert components(diagnosed(change, fig12())) == [("route", "tibi-nav", "missing")]


@pytest.mark.parametrize(("hop", "mode"), [("192.168.1.254", "missing"), ("192.168.1.77", "other")])
def test_a_lost_route_is_missing_beside_a_default_route(hop, mode):
    def change(seen):
        for target in INNER_TIBI:
            update(of(seen["car-visio"].probe.members, target).route, gateway=hop)

    assert components(diagnosed(change, fig12())) == [("route", "car-visio", mode)]


def test_a_gateway_without_a_route_looks_in_its_own_networks():
    def change(seen):
        for target in INNER_TIBI:
            update(of(seen["car-visio"].probe.members, target).route, gateway="192.168.1.254")
            for name in INNER_CAR:
                answer = no_answer("host unreachable", Outcome.HOST_UNREACHABLE, "192.168.1.203")
                update(
                    of(seen[name].probe.members, target),
                    ping_address=answer,
                    ping_name=answer,
                    loss=1.0,
                )

    assert components(diagnosed(change, fig12())) == [("route", "car-visio", "missing")]


def test_a_neighbour_that_nobody_finds_is_told():
    """A computer that answers ARP is there, whatever its packet filters drop. A lost question is no fault of the computer."""

    def rows(change):
        return {(row.observer, row.target): row for row in evaluate(change, fig12()) if row.check == "answers_arp"}

    good = rows(None)
    assert {target for observer, target in good if observer == "tibi-nav"} == {"tibi-visio", "tibi-monitor"}
    assert {target for observer, target in good if observer == "tibi-visio"} >= {"tibi-nav", "car-visio"}
    assert {row.verdict for row in good.values()} == {OK}
    lost = rows(lambda seen: no_arp(seen, "tibi-nav"))
    assert lost.keys() == good.keys() - {("tibi-visio", "tibi-nav"), ("tibi-monitor", "tibi-nav")}
    cut = rows(lambda seen: silent(seen, ["tibi-visio", "tibi-monitor"], ["tibi-nav"]))
    assert [row.target for row in cut.values() if row.verdict == FAILED] == ["tibi-nav", "tibi-nav"]


@pytest.mark.parametrize("saves", [True, False, None])
def test_an_interface_that_saves_power_is_suspected_of_a_loss(saves):
    def saving(seen):
        for entry in seen[ONE].probe.forwarding.interfaces:
            update(entry, power_save=saves)

    assert not diagnosed(saving).findings

    def both(seen):
        saving(seen)
        _loses(seen)

    (found,) = diagnosed(both).findings
    named = {component[:3] for component in (found.component, *found.rivals)}
    assert (found.component[:3] == ("link", ONE, "power_save")) == (saves is True)
    assert (("link", ONE, "power_save") in named) == (saves is True)
    assert found.sure == "inferred"


@pytest.mark.parametrize(("readable", "verdicts"), [(True, {OK}), (False, set())])
def test_a_packet_filter_without_arp_is_good_where_it_is_read(readable, verdicts):
    rows = evaluate(lambda seen: update(seen[ONE], filters=FilterChains(readable)))
    assert {row.verdict for row in rows if row.check == "arp_filter"} == verdicts


def test_what_is_lost_now_comes_before_what_was_started_again():
    """A service that has ended some minutes ago and runs again is shown by its value, and breaks nothing any more."""

    def change(seen):
        _large_lost(seen)
        update(of(seen[ONE].probe.services, "roscore"), restarts=3, age_s=100.0)

    assert [kind for kind, *_place in components(diagnosed(change))] == ["network", "service"]
