# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The reader of interfaces, addresses and routes, on texts of iproute2 and on this machine."""

import json
import socket

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine import network
from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine.network import Address, RouteTo
from ansible_collections.rosfleet.multimaster.plugins.module_utils._process import commands

IP_JSON = [
    {},
    {
        "ifname": "eth0",
        "flags": ["BROADCAST", "MULTICAST", "UP", "LOWER_UP"],
        "mtu": 1500,
        "addr_info": [{"family": "inet", "local": "192.168.1.229", "prefixlen": 24}, {}],
    },
]


def test_interfaces_of_this_machine():
    loopback = next(link for link in network.interfaces() if link.loopback)
    assert Address("127.0.0.1", 8, "inet") in loopback.addresses
    assert loopback.up is True
    assert loopback.index == socket.if_nametoindex(loopback.name)


def test_interfaces_from_json():
    assert [link.plain() for link in network.from_json(json.dumps(IP_JSON))] == [
        {
            "name": "eth0",
            "up": True,
            "multicast": True,
            "loopback": False,
            "mtu": 1500,
            "addresses": [{"address": "192.168.1.229", "prefix": 24, "family": "inet"}],
        }
    ]
    with pytest.raises(ValueError, match="expected a list"):
        network.from_json("{}")


def test_interfaces_that_cannot_be_read_are_a_sentence(monkeypatch):
    monkeypatch.setattr(network, "run", lambda _argv: commands.Answer(-1, b"", "ip could not be started"))
    with pytest.raises(OSError, match='the interfaces\' addresses cannot be read: "ip could not be started"'):
        network.interfaces()


@pytest.mark.parametrize(
    ("output", "expected"),
    [
        ("192.168.1.15 dev eth0 src 192.168.1.14 uid 0 \n    cache \n", RouteTo("x", None, "eth0", "192.168.1.14")),
        (
            "192.168.10.3 via 192.168.1.202 dev wlan0 src 192.168.1.229",
            RouteTo("x", "192.168.1.202", "wlan0", "192.168.1.229"),
        ),
        (
            "multicast 226.0.0.0 dev eth0 src 192.168.1.229 uid 0 \n    cache <mc> \n",
            RouteTo("x", None, "eth0", "192.168.1.229"),
        ),
        ("10.0.0.2 via inet6 fe80::1 dev eth0 src 10.0.0.1", RouteTo("x", "fe80::1", "eth0", "10.0.0.1")),
        ("default via 10.0.0.1 dev wlan0 proto dhcp metric 600", RouteTo("x", "10.0.0.1", "wlan0", None, "600")),
        ("", RouteTo("x")),
    ],
)
def test_a_route_from_text(output, expected):
    assert network.route_from_text(output, "x") == expected


def test_routes_of_this_machine():
    near, wrong = network.routes_to(["127.0.0.1", "no address"])
    assert (near.device, near.source, near.gateway, near.error) == ("lo", "127.0.0.1", None, "")
    assert wrong.error and wrong.plain() == {
        "destination": "no address",
        "gateway": None,
        "device": None,
        "source": None,
        "error": wrong.error,
    }


def test_the_routes_of_many_addresses_are_asked_of_one_process(monkeypatch):
    asked = []
    output = b"10.0.0.2 via 10.0.0.1 dev eth0 src 10.0.0.3 uid 0 \\    cache \nlocal 127.0.0.1 dev lo src 127.0.0.1 \\    cache <local>\n"
    error = "RTNETLINK answers: No route to host\nCommand failed -:2\nCommand failed -:3"

    def answered(argv, given):
        asked.append((argv[-2:], given))
        return commands.Answer(1, output, error)

    monkeypatch.setattr(network, "run", answered)
    wanted = ["10.0.0.2", "9.9.9.9", "evil\nroute flush", "9.9.9.8", "127.0.0.1", "10.0.0.2"]
    far, none, evil, silent, near, again = network.routes_to(wanted)
    lines = b"route get 10.0.0.2\nroute get 9.9.9.9\nroute get 9.9.9.8\nroute get 127.0.0.1\n"
    assert asked == [(["-batch", "-"], lines)], "each address once, and nothing that is none"
    assert far == again == RouteTo("10.0.0.2", "10.0.0.1", "eth0", "10.0.0.3")
    assert near == RouteTo("127.0.0.1", None, "lo", "127.0.0.1")
    assert (none.error, silent.error) == ("No route to host", "no route")
    assert evil == RouteTo("evil\nroute flush", error="this is no IPv4 address")


@pytest.mark.parametrize("output", [b"", b"one\ntwo\nthree\n"])
def test_answers_that_are_not_one_for_each_address_are_no_routes(monkeypatch, output):
    monkeypatch.setattr(network, "run", lambda argv, given: commands.Answer(-1, output, "no answer within 5 s"))
    assert [route.error for route in network.routes_to(["10.0.0.2", "10.0.0.3"])] == ["no answer within 5 s"] * 2


def test_default_routes(monkeypatch):
    output = b"default via 10.0.0.1 dev wlan0 metric 600\ndefault\n\tnexthop via 10.0.0.2 dev eth0 weight 1\n"
    monkeypatch.setattr(network, "run", lambda _argv: commands.Answer(0, output, ""))
    assert network.default_routes() == [RouteTo("default", "10.0.0.1", "wlan0", None, "600"), RouteTo("default")]
