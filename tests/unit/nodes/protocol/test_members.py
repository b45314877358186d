# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Who belongs to the fleet."""

import socket

import pytest
from fleet_of_one import ROUTER, TIBI, URI
from hypothesis import given
from hypothesis import strategies as st
from rosfleet_multimaster.protocol import parameters
from rosfleet_multimaster.protocol.members import Members, Networks, is_address, place_of


def members(strangers="ignore", allow=()):
    return Members.from_parameters({"members": [TIBI, ROUTER], "strangers": strangers, "allow": list(allow)})


@pytest.mark.parametrize("strangers", ["ignore", "allow"])
@pytest.mark.parametrize("address", ["192.168.1.201", "192.168.11.101"])
@pytest.mark.parametrize("uri", [URI, "http://Tibi-Visio:11311", "http://192.168.1.201:11311/"])
def test_a_member_is_itself_at_its_planned_addresses(strangers, address, uri):
    assert members(strangers).objection(uri, "tibi-visio", address) == ""


@pytest.mark.parametrize("strangers", ["ignore", "allow"])
@pytest.mark.parametrize("address", ["192.168.1.66", "192.168.11.102", "192.168.1.77"])
def test_a_member_is_nowhere_else_whatever_is_allowed(strangers, address):
    said = members(strangers, ["192.168.1.77/32"]).objection(URI, "tibi-visio", address)
    assert said == "it says that it is tibi-visio, which is at 192.168.1.201 or 192.168.11.101"


@pytest.mark.parametrize("strangers", ["ignore", "allow"])
def test_nobody_else_has_the_name_of_a_member(strangers):
    said = members(strangers, ["192.168.1.77/32"]).objection("http://rogue:11311/", "Tibi-Visio", "192.168.1.77")
    assert "it has the name of the master of a robot of the fleet" in said


def test_a_stranger_is_ignored_unless_it_is_allowed():
    rogue = ("http://rogue:11311/", "rogue", "192.168.1.66")
    assert members().objection(*rogue) == "it is no robot of the fleet"
    assert members("allow").objection(*rogue) == ""
    assert members(allow=["192.168.1.64/29"]).objection(*rogue) == ""
    assert Members().objection(*rogue) == ""


def test_a_second_master_on_a_members_computer_is_a_stranger():
    said = members().objection("http://tibi-visio:11411/", "tibi-visio_11411", "192.168.1.201")
    assert said == "it is on the computer of tibi-visio, whose master is not http://tibi-visio:11411/"


def test_computers_of_the_fleet_are_served_and_strangers_are_not():
    assert all(members().knows(address) for address in ("192.168.1.201", "192.168.11.102", "192.168.1.1"))
    assert not members().knows("192.168.1.66")
    assert members(allow=["192.168.1.66/32"]).knows("192.168.1.66")


@pytest.mark.parametrize("address", ["192.168.1.300", "tibi", "", "::1", "192.168.1.66/32"])
def test_what_is_no_address_is_in_no_network(address):
    assert address not in Networks(["192.168.1.64/29", "0.0.0.0/0"])


@pytest.mark.parametrize("table", [parameters.DISCOVERY, parameters.SYNC])
@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"strangers": "some"}, "~strangers is 'some', but ignore or allow is expected"),
        ({"allow": ["laptop"]}, "a list of IPv4 addresses and networks is expected"),
        ({"members": [{}]}, "entry 1 of ~members: robot, name, uris"),
        ({"members": [TIBI, {**TIBI, "uris": "x"}]}, "entry 2 of ~members: its uris are 'x', but a list of texts"),
        ({"members": [{**TIBI, "rpc_port": "x"}]}, "its rpc_port is 'x', but a number is expected"),
    ],
)
def test_a_wrong_value_is_a_sentence(table, given, said):
    with pytest.raises(parameters.ParameterError) as caught:
        parameters.overlay(table, given)
    assert said in str(caught.value)


def test_the_members_of_the_plan_are_taken():
    values, warnings = parameters.overlay(
        parameters.SYNC, {"members": [TIBI, ROUTER], "strangers": "ignore", "allow": []}
    )
    assert not warnings and Members.from_parameters(values).master(URI).robot == "tibi"


@pytest.mark.parametrize(
    ("uri", "place"),
    {
        "http://Tibi-Visio:34567/": ("tibi-visio", 34567),
        "rosrpc://tibi_laser.lab.:1": ("", 1),
        "rosrpc://tibi_laser.lab:1": ("tibi_laser.lab", 1),
        "http://192.168.1.9": ("192.168.1.9", 0),
        "http://[FE80:0::01]:9/": ("fe80::1", 9),
        "http://[::ffff:192.168.1.9]:9/": ("", 0),
        "http://[::FFFF:c0a8:109]:9/": ("", 9),
        "http://[fe80::1%eth0]:9/": ("", 0),
        "http://3com.example:9/": ("3com.example", 9),
        "http://example.3com:9/": ("example.3com", 9),
        "http://example.3:9/": ("", 9),
        "http://a..b:9/": ("", 9),
        "http://-a:9/": ("", 9),
        "http://a:65536/": ("", 0),
        "http://a:1_0/": ("", 0),
        "http://a:9/\n": ("", 0),
    }.items(),
)
def test_a_place_has_one_spelling(uri, place):
    assert place_of(uri) == place


@given(st.text("0123456789abcdefx.X-[]:%@/\uff11\u3002 ", max_size=24))
def test_what_libc_takes_for_an_address_is_one_or_refused(text):
    """inet_aton(3) has many spellings, and getaddrinfo(3) takes them all."""
    host = place_of(f"http://{text}:1/")[0]
    assert place_of(f"http://{host}:1/")[0] == host or ":" in host, "the only spelling is its own"
    try:
        socket.inet_aton(host)
    except OSError:
        return
    assert is_address(host)
