# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""People's nodes with a wrong host or roscore: which kind of fault, on which computer, by which process."""

import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.context.announcements import (
    find_misplaced,
    find_strays,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observe.observations import (
    AnnouncedHost,
    ForwardingInterface,
    NodeHost,
    RefusedName,
    SilentNode,
    UnregisteredNodes,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observe.outcomes import Outcome
from fleets import TWO, fig12, observed, of, plan, update

MASTER, INNER = "tibi-visio", "tibi-nav"
OTHER, OTHER_INNER = "dabo-nav", "dabo-visio"
NODE, PORT = "/odom", 41233


def _find(announced, silent=(), processes=None, fleet=None, interfaces=None):
    """The findings on one node of tibi; `processes` and `interfaces` by computer."""
    fleet = fleet or fig12()
    seen = observed(fleet)
    update(seen[MASTER].probe.exchange, announced=[announced], silent=silent)
    for name, rows in (processes or {}).items():
        update(seen[name].probe, node_hosts=rows)
    for name, rows in (interfaces or {}).items():
        update(seen[name].probe.forwarding, interfaces=[*seen[name].probe.forwarding.interfaces, *rows])
    probes = {name: one.probe for name, one in seen.items()}
    found = find_misplaced(fleet, probes)
    return found.get("tibi", {}).get(NODE), find_strays(fleet, probes, found)


def _process(host, **more):
    return NodeHost(host, more.pop("source", "ROS_IP"), "session-4.scope", (PORT, PORT + 1), "odom", **more)


def test_the_node_of_a_guest_may_have_a_foreign_address():
    fleet = plan(multimaster_allow=["10.9.8.0/24"])
    seen = observed(fleet)
    update(seen[TWO].probe.exchange, announced=[AnnouncedHost("/rviz", "10.9.8.7", PORT)])
    assert find_misplaced(fleet, {name: one.probe for name, one in seen.items()}) == {}
    update(seen[TWO].probe, node_hosts=[_process("10.9.8.7")])  # it runs on a computer of the fleet
    assert find_misplaced(fleet, {name: one.probe for name, one in seen.items()}) != {}


@pytest.mark.parametrize(
    ("host", "silent", "place"),
    [
        ("127.0.0.1", (), MASTER),  # it answers the roscore's computer there
        ("127.0.0.1", (NODE,), "tibi"),  # on another computer of the robot
        ("10.9.8.7", (), "tibi"),
    ],
)
def test_a_node_without_a_process_is_on_the_computer_where_it_answers(host, silent, place):
    found, _strays = _find(AnnouncedHost(NODE, host, PORT), silent)
    assert found.computer == place


DOCKER = ForwardingInterface("docker0", ("172.17.0.1",), prefixes=(16,))


@pytest.mark.parametrize(
    ("host", "mode", "detail"),
    [
        ("127.0.0.1", "loopback", ""),
        ("127.0.1.1", "loopback", ""),
        ("localhost", "loopback", ""),
        ("::1", "loopback", ""),
        ("laptop7", "name", ""),
        ("10.9.8.7", "address", ""),
        ("172.17.0.1", "interface", "docker0"),
        ("172.17.0.2", "interface", "docker0"),  # of a container with a network of its own
        ("192.168.10.100", "name_of_other", "dabo-nav"),  # of a computer of dabo
    ],
)
def test_each_kind_of_host_is_told(host, mode, detail):
    announced = AnnouncedHost(NODE, host, PORT)
    found, strays = _find(announced, (NODE,), {INNER: [_process(host)]}, interfaces={INNER: [DOCKER]})
    assert (found.mode, found.detail) == ("address" if mode == "name_of_other" else mode, detail)
    assert found.computer == INNER and found.process.unit == "session-4.scope" and not strays


def test_the_address_of_an_interface_leads_to_its_computer_without_a_process():
    found, _strays = _find(AnnouncedHost(NODE, "172.17.0.1", PORT), (), interfaces={INNER: [DOCKER]})
    assert (found.mode, found.computer, found.detail) == ("interface", INNER, "docker0")


@pytest.mark.parametrize("has_process", [True, False])
def test_a_node_of_another_robot_at_this_roscore_is_told_by_its_own_computer(has_process):
    uri = "http://tibi-visio:11311/"
    process = _process(OTHER_INNER, source="ROS_HOSTNAME", master=uri)
    processes = {OTHER_INNER: [process]} if has_process else {}
    found, strays = _find(AnnouncedHost(NODE, OTHER_INNER, PORT), (), processes)
    assert (found.mode, found.computer, found.detail) == ("robot", OTHER_INNER, "tibi") and not strays
    assert "uses the roscore of tibi (another robot)" in str(found)


def test_the_name_of_another_robots_computer_by_a_process_here_is_a_wrong_name():
    process = _process(OTHER_INNER, source="ROS_HOSTNAME")
    found, _strays = _find(AnnouncedHost(NODE, OTHER_INNER, PORT), (NODE,), {INNER: [process]})
    assert (found.mode, found.computer) == ("name", INNER) and "(of robot dabo) by ROS_HOSTNAME" in str(found)


def test_a_node_with_another_robots_name_and_without_an_answer_is_no_guest():
    found, _strays = _find(AnnouncedHost(NODE, OTHER_INNER, PORT), (NODE,))
    assert (found.mode, found.computer) == ("name", "tibi") and "(of robot dabo, where it does not answer)" in str(
        found
    )


def test_services_elsewhere_are_told():
    found, _strays = _find(AnnouncedHost(NODE, INNER, PORT, services="127.0.0.1"))
    assert (found.mode, found.computer) == ("services", INNER)
    assert f"announces {INNER}, and 127.0.0.1 for its services" in str(found)


@pytest.mark.parametrize("name", ["odom", '"odom"'])  # a name of letters alone comes in quotes
def test_a_process_that_cannot_be_read_is_found_by_its_name(name):
    unread = NodeHost("", "", "docker-77.scope", (), name, starter="container", readable=False)
    found, _strays = _find(AnnouncedHost(NODE, "10.9.8.7", PORT), (NODE,), {INNER: [unread]})
    assert (found.computer, found.process) == (INNER, unread) and " by " not in str(found)


def test_a_process_with_a_roscore_of_nobody_is_a_stray():
    process = _process(INNER, master="http://old-pc:11311/")
    found, strays = _find(AnnouncedHost("/other", "tibi-visio", PORT), (), {INNER: [process]})
    assert found is None
    assert [(one.mode, one.computer) for one in strays[INNER]] == [("master", INNER)]


def test_a_process_with_the_roscore_of_another_robot_that_was_not_read_is_told():
    process = _process(INNER, master="http://dabo-nav:11311/")
    _found, strays = _find(AnnouncedHost("/other", "tibi-visio", PORT), (), {INNER: [process]})
    assert [(one.mode, one.detail) for one in strays[INNER]] == [("robot", "dabo")]


@pytest.mark.parametrize("address", ["nonsense", "172.17.0.1/99/x", ""])
def test_a_strange_interface_costs_nothing(address):
    strange = ForwardingInterface("x", (address,), prefixes=(1 << 70,))
    found, _strays = _find(AnnouncedHost(NODE, "172.17.0.1", PORT), (), interfaces={INNER: [strange]})
    assert found.mode == "address"


@pytest.mark.parametrize(
    ("addresses", "refused", "is_told"),
    [
        (("192.168.11.100",), False, False),  # that of tibi-nav
        (("192.168.11.100",), True, True),  # another robot does not know the name
        (("192.168.10.100",), False, True),  # that of a computer of dabo
        (("127.0.1.1",), False, True),
        ((), False, True),
    ],
)
def test_another_name_that_leads_home_everywhere_is_fine(addresses, refused, is_told):
    fleet = fig12()
    seen = observed(fleet)
    announced = AnnouncedHost(NODE, "tibi-nav.local", PORT, addresses)
    update(seen[MASTER].probe.exchange, announced=[announced])
    if refused:
        refusal = RefusedName(NODE, "place", "http://tibi-nav.local:41233/", MASTER, "it is no computer of tibi")
        update(of(seen[OTHER].probe.services, "sync"), refusals=[refusal])
    found = find_misplaced(fleet, {name: one.probe for name, one in seen.items()})
    assert bool(found) is is_told
    assert not refused or found["tibi"][NODE].refused == (("dabo", "it is no computer of tibi"),)


@pytest.mark.parametrize(
    ("computer", "more", "found"),
    [
        (INNER, {"apart": True}, True),
        (INNER, {"apart": False}, False),  # it listens on the computer, so something else is in the way
        (MASTER, {"apart": True}, False),  # another node has the same port
    ],
)
def test_a_node_in_a_network_of_its_own_is_not_on_the_computer_that_it_announces(computer, more, found):
    fleet = fig12()
    seen = observed(fleet)
    silence = SilentNode(NODE, INNER, "Connection refused", Outcome.REFUSED, port=PORT)
    update(seen[MASTER].probe.exchange, silent=[NODE], silences=[silence])
    update(seen[computer].probe, node_hosts=[_process(INNER, **more)])
    told = find_misplaced(fleet, {name: one.probe for name, one in seen.items()}).get("tibi", {})
    assert [(one.mode, one.computer) for one in told.values()] == ([("network", INNER)] if found else [])


def test_a_node_without_a_registration_is_told_by_its_process_alone():
    seen = observed(fig12())
    update(
        seen[INNER].probe,
        unregistered=UnregisteredNodes([_process(INNER, pid=7), _process(INNER, pid=8, topics=("/odom",))], 2, 2),
    )
    (first, second) = find_strays(fig12(), {name: one.probe for name, one in seen.items()}, {})[INNER]
    assert (first.mode, first.computer, str(first)) == ("unregistered", INNER, "odom (process 7, in session-4.scope)")
    assert str(second) == "odom (process 8, publishes /odom, in session-4.scope)"
