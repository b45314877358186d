# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Rules of policy routing: what `ip rule` prints, and the route that a kernel takes with them."""

from dataclasses import replace
from ipaddress import IPv4Address, IPv4Interface, IPv4Network

import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._base import advice
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._network.model import (
    Interface,
    Lookup,
    Machine,
    Packet,
    Route,
    kernel_routes,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._network.policy import lookups, write_rule

ANY, NETWORK = IPv4Network("0.0.0.0/0"), IPv4Network("192.168.12.0/24")
TARGET, OTHER = IPv4Address("192.168.12.7"), IPv4Address("192.168.13.7")
WIRE = Interface("eth0", (IPv4Interface("192.168.1.5/24"),), "wire")
BY_DEFAULT = Route(ANY, IPv4Address("192.168.1.254"), "eth0")
BY_RULE = Route(ANY, IPv4Address("192.168.1.77"), "eth0")


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("100: from all to 192.168.12.0/24 lookup 77", Lookup(100, "77", destination=NETWORK)),
        ("100: from 192.168.1.5 lookup isp proto static", Lookup(100, "isp", source=IPv4Network("192.168.1.5"))),
        ("9: from all iif wlan0 [detached] lookup 9", Lookup(9, "9", incoming="wlan0")),
        ("9: from all to 192.168.12.0/24 blackhole", Lookup(9, "", destination=NETWORK, kind="blackhole")),
        (
            "99: from all ipproto tcp sport 5 dport 22-80 prohibit",
            Lookup(99, "", kind="prohibit", protocol="tcp", ports=(22, 80), source_ports=(5, 5)),
        ),
        ("99: from all ipproto 6 lookup 9", Lookup(99, "9", protocol="tcp")),
        ("32764: from all lookup main suppress_prefixlength 0", Lookup(32764, "main", longer=0)),
        ("32765: not from all fwmark 0xca6c lookup 51820", Lookup(32765, "51820")),
    ],
)
def test_a_rule_is_read(line, expected):
    assert lookups([line]) == (expected,)


@pytest.mark.parametrize(
    "line",
    [
        "9: from all fwmark 0x1 lookup 9",
        "9: from all uidrange 0-99 lookup 9",
        "9: from all ipproto tcp dport x lookup 9",
        "9: not from 192.168.1.0/24 lookup 9",
        "9: from all goto 100",
        "9: from all kind elsewhere",
        "9: from somewhere lookup 9",
        "9: from all lookup main suppress_prefixlength x",
        "from all lookup 9",
        "\u00b2: not from all fwmark 0x1 lookup 9",
        f"{'9' * 5000}: not from all fwmark 0x1 lookup 9",
        "",
        "9:",
    ],
)
def test_a_rule_for_other_packets_or_an_unknown_one_is_left_out(line):
    assert lookups([line]) == ()


def to(destination, source=None):
    return Packet("icmp", destination, source and IPv4Address(source))


def machine(rules, **tables):
    return Machine(
        "a", (WIRE,), (*kernel_routes(WIRE), BY_DEFAULT), lookups=lookups(rules), tables={"77": (BY_RULE,), **tables}
    )


@pytest.mark.parametrize(
    ("rules", "expected"),
    [
        ([], BY_DEFAULT),
        (["100: from all to 192.168.12.0/24 lookup 77"], BY_RULE),
        (["32767: from all to 192.168.12.0/24 lookup 77"], BY_DEFAULT),  # the table main comes first
        (["100: from all to 192.168.12.0/24 lookup 78"], BY_DEFAULT),  # an empty table says nothing
        (["100: from 192.168.1.5 lookup 77"], BY_DEFAULT),  # before it has an address
        (["100: from all iif eth0 lookup 77"], BY_DEFAULT),
        (["100: from all iif lo lookup 77"], BY_RULE),
        (["90: from all lookup main suppress_prefixlength 0", "100: from all lookup 77"], BY_RULE),
    ],
)
def test_the_route_of_a_packet_that_is_sent_here(rules, expected):
    assert machine(rules).route(to(TARGET)) == expected


def test_the_route_of_a_packet_that_is_passed_on():
    rules = ["100: from 10.0.0.0/8 iif eth0 lookup 77"]
    assert machine(rules).route(to(TARGET, "10.0.0.1"), "eth0") == BY_RULE
    assert machine(rules).route(to(TARGET, "10.0.0.1"), "eth1") == BY_DEFAULT
    assert machine(rules).route(to(TARGET, "192.168.1.9"), "eth0") == BY_DEFAULT


def test_a_rule_or_a_table_may_lead_nowhere_and_throw_goes_on():
    closed = machine(["100: from all to 192.168.12.0/24 unreachable"])
    assert closed.route(to(TARGET)).kind == "unreachable" and closed.route(to(OTHER)) == BY_DEFAULT
    throws = machine(["100: from all lookup 78"], **{"78": (Route(ANY, kind="throw"),)})
    assert throws.route(to(TARGET)) == BY_DEFAULT
    blackhole = machine(["100: from all lookup 78"], **{"78": (Route(NETWORK, kind="blackhole"),)})
    assert blackhole.route(to(TARGET)).kind == "blackhole" and blackhole.route(to(OTHER)) == BY_DEFAULT


@pytest.mark.parametrize(
    "words",
    [
        "priority 99 from all blackhole",
        "priority 99 from 192.168.1.0/24 to 192.168.12.0/24 unreachable",
        "priority 99 from all to 192.168.12.1 ipproto tcp sport 5 dport 22-80 prohibit",
    ],
)
def test_a_rule_is_deleted_by_the_words_it_was_read_by(words):
    (rule,) = lookups([words.replace("priority 99", "99:")])
    assert write_rule(rule) == words
    assert advice.command("ip rule del {}", ("rule", words)) == f"ip rule del {words}"


def test_a_rule_for_a_port_takes_only_packets_to_it():
    one = machine(["99: from all ipproto tcp dport 11311 prohibit"])
    asked = Packet("tcp", TARGET, port=11311)
    assert one.route(asked).kind == "prohibit"
    for other in (replace(asked, port=11611), replace(asked, protocol="udp"), to(TARGET)):
        assert one.route(other) == BY_DEFAULT
