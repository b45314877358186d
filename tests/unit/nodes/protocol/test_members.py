# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The members of the fleet."""

import pytest
from fleet_of_one import ROUTER, TIBI, URI
from mentioned import mentions
from rosfleet_multimaster.protocol import parameters
from rosfleet_multimaster.protocol.members import Members, Networks


def members(strangers="ignore", allow=()):
    return Members.from_parameters({"members": [TIBI, ROUTER], "strangers": strangers, "allow": list(allow)})


@pytest.mark.parametrize("strangers", ["ignore", "allow"])
@pytest.mark.parametrize("address", ["192.168.1.201", "192.168.11.101"])
@pytest.mark.parametrize("uri", [URI, "http://Tibi-Visio:11311", "http://192.168.1.201:11311/"])
def test_a_member_is_itself_at_its_planned_addresses(strangers, address, uri):
    assert members(strangers).find_refusal(uri, "tibi-visio", address) == ""


@pytest.mark.parametrize("strangers", ["ignore", "allow"])
@pytest.mark.parametrize("address", ["192.168.1.66", "192.168.11.102", "192.168.1.77"])
def test_a_member_is_nowhere_else_whatever_is_allowed(strangers, address):
    said = members(strangers, ["192.168.1.77/32"]).find_refusal(URI, "tibi-visio", address)
    assert mentions(said, "tibi-visio", "192.168.1.201", "192.168.11.101")


@pytest.mark.parametrize("strangers", ["ignore", "allow"])
def test_nobody_else_has_the_name_of_a_member(strangers):
    said = members(strangers, ["192.168.1.77/32"]).find_refusal("http://rogue:11311/", "Tibi-Visio", "192.168.1.77")
    assert mentions(said, "name", "master")


def test_a_stranger_is_ignored_unless_it_is_allowed():
    rogue = ("http://rogue:11311/", "rogue", "192.168.1.66")
    assert members().find_refusal(*rogue) == "it is no robot of the fleet"
    assert members("allow").find_refusal(*rogue) == ""
    assert members(allow=["192.168.1.64/29"]).find_refusal(*rogue) == ""
    assert Members().find_refusal(*rogue) == ""


def test_a_second_master_on_a_members_computer_is_a_stranger():
    said = members().find_refusal("http://tibi-visio:11411/", "tibi-visio_11411", "192.168.1.201")
    assert mentions(said, "tibi-visio", "http://tibi-visio:11411/")


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
        ({"strangers": "some"}, "some allow"),
        ({"allow": ["laptop"]}, "IPv4 networks"),
        ({"members": [{}]}, "1 uris"),
        ({"members": [TIBI, {**TIBI, "uris": "x"}]}, "2 x"),
        ({"members": [{**TIBI, "rpc_port": "x"}]}, "rpc_port x"),
    ],
)
def test_a_wrong_value_is_a_sentence(table, given, said):
    with pytest.raises(parameters.ParameterError) as caught:
        parameters.overlay(table, given)
    assert mentions(str(caught.value), *said.split())


def test_the_members_of_the_plan_are_taken():
    values, warnings = parameters.overlay(
        parameters.SYNC, {"members": [TIBI, ROUTER], "strangers": "ignore", "allow": []}
    )
    assert not warnings and Members.from_parameters(values).master(URI).robot == "tibi"
