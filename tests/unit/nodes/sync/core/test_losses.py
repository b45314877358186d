# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
import pytest
from rosfleet_multimaster.protocol.members import Members
from rosfleet_multimaster.protocol.messages import Registration, View
from rosfleet_multimaster.sync.core import losses as module
from rosfleet_multimaster.sync.core.losses import (
    FORGET,
    RESOLVE,
    Connection,
    Disconnection,
    Look,
    Losses,
    connections_of,
)

R2 = "http://robot2:11311/"
TALKER = ("/talker", "http://robot2:40000/")
OWN, ALONE = ("/listener", "http://robot1:30000/"), ("/alone", "http://robot1:30001/")
HELD = {Registration("publisher", "/chatter", *TALKER): R2}
CLAIMS = {TALKER: R2}
VIEW = View(
    {"/chatter": ["/talker"], "/other": ["/alone"]}, {"/chatter": ["/listener"]}, {}, {}, dict([TALKER, OWN, ALONE])
)
ADDRESS = "192.168.1.2"
NOTED = {Connection(41000, 40001)}


ROBOT2 = {
    "robot": "robot2",
    "name": "robot2",
    "uris": [R2],
    "rpc_port": 11611,
    "addresses": [ADDRESS],
    "hosts": ["robot2", ADDRESS, "robot2-arm", "192.168.12.7"],
}


def known(members=()):
    losses = Losses(Members.from_parameters({"members": members}))
    losses.take_registrations(HELD, VIEW, CLAIMS)
    assert losses.to_resolve(0.0) == ["robot2"]
    losses.take_addresses("robot2", frozenset([ADDRESS]), 0.0)
    assert losses.update({R2: True}, 1.0) == ([], [])
    return losses


def test_while_a_master_is_lost_what_leads_to_its_nodes_is_ended():
    losses = known()
    assert losses.endpoints() == set()
    losses.update({R2: False}, 10.0)
    losses.take_registrations({}, VIEW, {})  # it is withdrawn, and remembered
    assert losses.endpoints() == {(ADDRESS, 40000)}
    losses.update({}, 300.0)  # discovery has removed it
    assert losses.endpoints() == {(ADDRESS, 40000)}
    losses.update({R2: True}, 320.0)
    assert losses.endpoints() == set()


def test_at_a_loss_own_nodes_are_asked_and_ended_at_the_return():
    losses = known()
    (look,), endings = losses.update({R2: False}, 10.0)
    assert look == Look(R2, frozenset([OWN]), frozenset(TALKER)) and endings == []
    losses.take_connections(R2, NOTED)
    assert losses.update({R2: False}, 11.0) == ([], [])
    looks, (ending,) = losses.update({R2: True}, 80.0)
    assert looks == [] and ending == Disconnection(frozenset([ADDRESS]), frozenset(NOTED), 70.0)
    assert losses.update({R2: True}, 81.0) == ([], [])


@pytest.mark.parametrize(
    ("local_port", "remote", "silent", "wanted"),
    [
        (41000, (ADDRESS, 40001), 75.0, True),
        (41000, (ADDRESS, 40001), 3.0, False),  # it works again, or has never stopped: the master's roscore was away
        (41000, ("192.168.1.3", 40001), 75.0, False),
        (41000, (ADDRESS, 40002), 75.0, False),
        (41001, (ADDRESS, 40001), 75.0, False),
        (50000, (ADDRESS, 61234), 75.0, True),  # who is called does not know from which port
    ],
)
def test_only_noted_connections_that_are_still_silent_end(local_port, remote, silent, wanted):
    ending = Disconnection(frozenset([ADDRESS]), frozenset([*NOTED, Connection(50000, None)]), 70.0)
    assert ending.wants(local_port, remote, silent) is wanted


def test_a_master_that_has_left_is_not_lost():
    losses = known()
    assert losses.update({}, 10.0) == ([], [])
    assert losses.endpoints() == set()


def test_a_lost_master_is_forgotten_when_tcp_has_given_up_too():
    losses = known()
    losses.update({R2: False}, 10.0)
    losses.update({}, 10.0 + FORGET)
    assert losses.endpoints() == set()
    assert losses.update({R2: True}, 2000.0) == ([], [])


def test_hosts_are_resolved_while_it_is_possible():
    losses = known()
    assert losses.to_resolve(RESOLVE - 1) == []
    assert losses.to_resolve(RESOLVE) == ["robot2"]
    losses.update({R2: False}, RESOLVE)
    assert losses.to_resolve(3 * RESOLVE) == []
    assert losses.endpoints() == {(ADDRESS, 40000)}  # known from before


ROSPY = "TCPROS connection on port 41374 to [127.0.0.1:40623 on socket 6]"


@pytest.mark.parametrize(
    ("destination", "text", "found"),
    [
        ("http://robot2:40000/", ROSPY, {Connection(41374, 40623)}),
        ("/talker", "TCPROS connection on port 41374 to [robot2:40623 on socket 6]", {Connection(41374, 40623)}),
        ("/talker", "TCPROS connection on port 41374 to [None:None on socket 9]", {Connection(41374, None)}),
        ("/else", ROSPY, set()),
        ("/talker", "Closed " + ROSPY, set()),
        ("/talker", "UDPROS connection on port 41374 to [robot2:40623 on socket 6]", set()),
        ("/talker", None, set()),
    ],
)
def test_connections_as_rospy_and_roscpp_describe_them(destination, text, found):
    rows = [[1, destination, "i", "TCPROS", "/chatter", True, text], [2, "/talker", "o"], None]
    assert connections_of(rows, frozenset(TALKER)) == found
    assert connections_of(None, frozenset(TALKER)) == set()


@pytest.mark.parametrize("port", ["41374", "40623"])
def test_a_port_of_a_million_digits_is_none(port):
    """Python before 3.11 takes many seconds for such a number, and everything waits; later ones raise ValueError."""
    text = ROSPY.replace(port, "1" * 1_000_000)
    assert connections_of([[1, "/talker", "i", "TCPROS", "/chatter", True, text]], frozenset(TALKER)) == set()


def test_addresses_of_hosts_that_are_gone_are_forgotten():
    losses = Losses(Members())
    for number in range(10):
        item = Registration("publisher", "/chatter", "/talker", f"http://host{number}:40000/")
        losses.take_registrations({item: R2}, VIEW, {item.node_key: R2})
        assert losses.to_resolve(float(number)) == [f"host{number}", *(["robot2"] if number == 0 else [])]
    assert set(losses._addresses) == {"host9", "robot2"}


def test_a_node_of_a_master_that_is_there_is_never_cut_off():
    """The robot came back with another ROS_HOSTNAME, and a node has its port again."""
    losses, again = known(), "http://192.168.1.2:11311/"
    losses.update({R2: False}, 10.0)
    item = Registration("publisher", "/chatter", "/talker", f"http://{ADDRESS}:40000/")
    losses.take_registrations({item: again}, VIEW, {item.node_key: again})
    losses.to_resolve(11.0)
    losses.take_addresses(ADDRESS, frozenset([ADDRESS]), 11.0)
    losses.update({again: True}, 12.0)
    assert losses.endpoints() == set()


def lost(members, master, claims):
    """The connections that are ended for a lost master that claims nodes: `claims` is URI of a node -> addresses of its host."""
    losses, own = Losses(Members.from_parameters({"members": members})), "http://robot1:30000/"
    view = View({}, {"/chatter": ["/listener"]}, {}, {}, {"/listener": own})
    held = {Registration("publisher", "/chatter", f"/node{number}", uri): master for number, uri in enumerate(claims)}
    losses.take_registrations(held, view, {item.node_key: master for item in held})
    addresses = {"robot2": {ADDRESS}, "robot3": {"192.168.1.3"}, "rogue": {"192.168.1.66"}}
    addresses.update({uri.split("/")[2].split(":")[0]: found for uri, found in claims.items()})
    for host in losses.to_resolve(0.0):
        losses.take_addresses(host, frozenset(addresses.get(host, ())), 0.0)
    losses.update({master: True}, 1.0)
    losses.update({master: False}, 10.0)
    losses.take_connections(master, {Connection(41000, None)})
    endpoints = losses.endpoints()
    (ending,) = losses.update({master: True}, 80.0)[1]
    return endpoints, ending.addresses


def test_claims_of_a_lost_stranger_end_nothing_of_others():
    """It registers nodes at another robot, at its roscore and at its discovery, and goes silent."""
    claims = {f"http://robot2:{port}/": {ADDRESS} for port in (40000, 11311, 11611, 22)}
    claims["http://rogue:40000/"] = {"192.168.1.66"}
    for members in ([], [ROBOT2]):
        assert lost(members, "http://rogue:11311/", claims) == ({("192.168.1.66", 40000)}, {"192.168.1.66"})


def test_a_stranger_with_the_host_of_a_robot_ends_nothing_there():
    claims = {"http://robot2:40000/": {ADDRESS}}
    for uri in ("http://robot2:11999/", f"http://{ADDRESS}:11999/"):
        assert lost([ROBOT2], uri, claims) == (set(), frozenset())


def test_a_lost_member_is_believed_for_its_own_computers_alone():
    claims = {
        "http://robot2:40000/": {ADDRESS},
        "http://robot2-arm:40001/": {"192.168.12.7"},
        "http://robot3:40002/": {"192.168.1.3"},
        "http://robot2:11311/": {ADDRESS},
        "http://robot2:11611/": {ADDRESS},
        "http://robot2:80/": {ADDRESS},
        "http://robot2:99999/": {ADDRESS},
    }
    assert lost([ROBOT2], R2, claims) == (
        {(ADDRESS, 40000), ("192.168.12.7", 40001)},
        {ADDRESS, "192.168.12.7"},
    )


def test_what_is_known_of_nodes_is_not_read_again(monkeypatch):
    """Each step and each loss looks at all of them, and twenty robots may have 50,000."""
    losses = known()
    losses.update({R2: False}, 10.0)
    losses.take_registrations({}, VIEW, {})
    for read in ("port_of", "host_of"):
        monkeypatch.setattr(module, read, lambda uri: uri == R2 and "robot2")
    monkeypatch.setattr(View, "local_nodes", None)  # of all topics, for each master that is lost
    losses.take_registrations(HELD, VIEW, CLAIMS)
    assert losses.endpoints() == {(ADDRESS, 40000)} and losses.to_resolve(11.0) == []
    losses.update({R2: True}, 12.0)
    (look,), _endings = losses.update({R2: False}, 13.0)
    assert look.nodes == {OWN} and losses.endpoints() == {(ADDRESS, 40000)}
