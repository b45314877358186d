# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The reader of interfaces, addresses and routes, on texts of iproute2 and on this machine."""

import json
import os
import socket
import sys

import namespaces
import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._base import commands
from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine import network
from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine.network import (
    Address,
    RouteTo,
    UpperInterface,
)

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
            "point_to_point": False,
            "addresses": [{"address": "192.168.1.229", "prefix": 24, "family": "inet"}],
            "port_of": "",
            "macvlan_of": "",
        }
    ]
    with pytest.raises(ValueError, match="expected a list"):
        network.from_json("{}")


def test_details_that_are_broken_hide_no_interface(monkeypatch):
    def run(argv):
        return commands.Answer(0, b'[{"ifname": "lo"' if "-details" in argv else b'[{"ifname": "lo"}]', "")

    monkeypatch.setattr(network, "run", run)
    assert [link.name for link in network.interfaces()] == ["lo"]


def test_interfaces_that_cannot_be_read_are_a_sentence(monkeypatch):
    monkeypatch.setattr(network, "run", lambda _argv: commands.Answer(-1, b"", "ip could not be started"))
    with pytest.raises(OSError, match="interfaces.*started"):
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
    near, wrong = map(network.route_to, ("127.0.0.1", "no address"))
    assert (near.device, near.source, near.gateway, near.error) == ("lo", "127.0.0.1", None, "")
    assert wrong.error and wrong.plain() == {
        "destination": "no address",
        "gateway": None,
        "device": None,
        "source": None,
        "error": wrong.error,
    }


@pytest.mark.parametrize(
    ("error", "expected"),
    [
        ("RTNETLINK answers: No route to host", "No route to host"),
        ("", "no route"),
        ("ip gave no answer within 5 s", "ip gave no answer within 5 s"),
    ],
)
def test_a_route_that_is_not_there_is_an_error(monkeypatch, error, expected):
    monkeypatch.setattr(network, "run", lambda _argv: commands.Answer(2, b"", error))
    assert network.route_to("9.9.9.9") == RouteTo("9.9.9.9", error=expected)


def test_what_is_no_address_is_not_asked(monkeypatch):
    monkeypatch.setattr(network, "run", None)
    for text in ("evil\nroute flush", "table", "::1", ""):
        assert network.route_to(text) == RouteTo(text, error="this is no IPv4 address")


def test_default_routes(monkeypatch):
    output = b"default via 10.0.0.1 dev wlan0 metric 600\ndefault\n\tnexthop via 10.0.0.2 dev eth0 weight 1\n"
    monkeypatch.setattr(network, "run", lambda _argv: commands.Answer(0, output, ""))
    assert network.default_routes() == [RouteTo("default", "10.0.0.1", "wlan0", None, "600"), RouteTo("default")]


def test_addresses_of_names_are_looked_up():
    assert network.resolve("localhost") == (["127.0.0.1"], "")
    addresses, error = network.resolve("no.such.name.invalid")
    assert addresses == [] and error
    for length in (70, 300):
        assert network.resolve("a" * length)[0] == []  # a label that no resolver takes


SHOW_PORTS = """
import json
from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine import network
print(json.dumps({entry.name: [entry.port_of, entry.macvlan_of] for entry in network.interfaces()}))
"""


@pytest.mark.slow
@pytest.mark.skipif(bool(namespaces.why_not()), reason=namespaces.why_not())
def test_an_interface_tells_what_is_above_and_below_it(tmp_path):
    computers = namespaces.Network(1, tmp_path)
    (one,) = computers.hosts
    try:
        one.run("ip", "link", "add", "br0", "type", "bridge")
        one.run("ip", "link", "set", "eth0", "master", "br0")
        one.run("ip", "link", "add", "upper", "link", "br0", "type", "macvlan")
        environment = {**os.environ, "PYTHONPATH": str(namespaces.COLLECTIONS)}
        found = json.loads(one.run(sys.executable, "-c", SHOW_PORTS, env=environment))
    finally:
        computers.end()
    assert {"eth0": ["br0", ""], "br0": ["", ""], "upper": ["", "br0"], "lo": ["", ""]}.items() <= found.items()


def test_ports_of_bridges_and_bonds_from_json():
    """The ports of a routing domain (vrf) show their packets themselves, and nobody else does."""
    links = [
        {},
        {"ifname": "lo"},
        {"ifname": "br0", "address": "02:00:00:00:00:01", "linkinfo": {"info_kind": "bridge"}},
        {"ifname": "bond0", "address": "02:00:00:00:00:02", "master": "br0", "linkinfo": {"info_kind": "bond"}},
        {"ifname": "red", "address": "02:00:00:00:00:03", "linkinfo": {"info_kind": "vrf"}},
        {"ifname": "eth0", "master": "bond0", "linkinfo": {"info_slave_kind": "bond"}},
        {"ifname": "eth1", "master": "red"},
    ]
    assert network.list_ports(json.dumps(links)) == {
        "bond0": UpperInterface("br0", "02:00:00:00:00:01"),
        "eth0": UpperInterface("bond0", "02:00:00:00:00:02"),
    }
    with pytest.raises(ValueError, match="expected a list"):
        network.list_ports("{}")
    assert isinstance(network.read_ports(), dict)
