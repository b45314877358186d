# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The wanted routes: items of the option, and what the kernel would refuse. Pure."""

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.routes import options as route_options
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.routes.kernel import RouteSpec
from ansible_collections.rosfleet.multimaster.plugins.module_utils._base.problem import Problem
from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine.network import Address, NetworkInterface
from planned_routes import DEFAULTS


def link(*addresses, up=True, loopback=False):
    split = [address.split("/") for address in addresses]
    entries = [Address(text, int(length), "inet6" if ":" in text else "inet") for text, length in split]
    return NetworkInterface("", up=up, loopback=loopback, addresses=tuple(entries))


INTERFACES = {
    "lo": link("127.0.0.1/8", "::1/128", loopback=True),
    "eth0": link("192.168.11.100/24", "fd00:11::100/64", "fe80::1/64"),
    "eth1": link("192.168.1.201/24"),
    "eth2": link("192.168.1.130/25", "10.0.0.1/24"),
    "wlan0": link("10.0.0.2/24", up=False),
}


def items(*given):
    return route_options.parse_routes(
        [{**DEFAULTS, **item} for item in given], INTERFACES, {"main": 254, "local": 255}, lambda version: ()
    )


def route(destination, gateway="", device="eth0", metric=None, **more):
    if metric is None:
        metric = 1024 if ":" in destination else 0
    return RouteSpec(destination, gateway, device, metric, **more)


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ({"destination": "default", "gateway": "192.168.11.101"}, route("0.0.0.0/0", "192.168.11.101")),
        ({"destination": "0.0.0.0/0", "gateway": "192.168.11.101"}, route("0.0.0.0/0", "192.168.11.101")),
        ({"destination": "::/0", "gateway": "FD00:11::0001"}, route("::/0", "fd00:11::1")),
        ({"destination": "::/0", "gateway": "fe80::9", "device": "eth0"}, route("::/0", "fe80::9")),
        (
            {"destination": "192.168.10.7", "gateway": "192.168.1.202"},
            route("192.168.10.7/32", "192.168.1.202", "eth2"),
        ),
        ({"destination": "10.1.0.0/16", "gateway": "192.168.1.20"}, route("10.1.0.0/16", "192.168.1.20", "eth1")),
        ({"destination": "fd00:5::/64", "device": "eth0", "metric": 0}, route("fd00:5::/64")),
        ({"destination": "10.5.0.0/16", "type": "blackhole"}, route("10.5.0.0/16", device="", type="blackhole")),
        ({"destination": "10.5.0.0/16", "device": "eth0", "table": "main", "scope": "link"}, route("10.5.0.0/16")),
        (
            {"destination": "10.5.0.0/16", "device": "eth0", "table": "100", "mtu": 9},
            route("10.5.0.0/16", table=100, mtu=9),
        ),
    ],
)
def test_what_an_item_means(given, expected):
    assert items(given)[0].route == expected


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"destination": "192.168.11.5/24", "device": "eth0"}, ["no network", "host bits"]),
        ({"destination": "dabo", "device": "eth0"}, ["no network", "dabo"]),
        ({"destination": "default"}, ["neither gateway nor device"]),
        (
            {"destination": "default", "gateway": "192.168.99.1"},
            ["no interface", "192.168.99.1", "eth0 192.168.11.100/24"],
        ),
        ({"destination": "default", "gateway": "10.0.0.9"}, ["eth2, wlan0", "device"]),
        ({"destination": "default", "gateway": "fd00:11::1"}, ["IPv6", "::/0"]),
        ({"destination": "::/0", "gateway": "fe80::9"}, ["link-local", "device"]),
        ({"destination": "default", "device": "eth9"}, ["no interface eth9"]),
        ({"destination": "default", "gateway": "x"}, ["no address"]),
        ({"destination": "default", "device": "eth0", "metric": -1}, ["metric -1"]),
        ({"destination": "default", "device": "eth0", "table": 255}, ["table 255"]),
        ({"destination": "default", "device": "eth0", "on_link": True}, ["on_link"]),
        ({"destination": "10.5.0.0/16", "type": "blackhole", "gateway": "192.168.11.1"}, ["blackhole", "gateway"]),
        ({"destination": "10.5.0.0/16", "type": "throw", "mtu": 1400}, ["throw", "mtu"]),
        ({"destination": "10.5.0.0/16", "device": "eth0", "table": "robots"}, ["no routing table robots", "main"]),
        ({"destination": "10.5.0.0/16", "device": "eth0", "table": "local"}, ["table 255"]),
        ({"destination": "10.5.0.0/16", "device": "eth0", "mtu": -1}, ["mtu -1"]),
        ({"destination": "fd00:5::/64", "device": "eth0", "scope": "link"}, ["IPv6 has no scopes"]),
        ({"destination": "10.5.0.0/16", "gateway": "192.168.11.1", "scope": "host"}, ["scope host"]),
    ],
)
def test_an_item_that_cannot_be_meant_is_one_sentence(given, words):
    with pytest.raises(Problem) as caught:
        items(given)
    assert str(caught.value).startswith("routes: item 1 (")
    assert all(word in str(caught.value) for word in words), str(caught.value)


def test_the_same_item_twice_is_one():
    one = {"destination": "default", "gateway": "192.168.11.101"}
    assert len(items(one, {**one, "destination": "0.0.0.0/0"})) == 1
    assert len(items(one, {**one, "metric": 5})) == 2
    with pytest.raises(Problem, match="two routes to default with metric 0 in table 254"):
        items(one, {**one, "gateway": "192.168.11.102"})


@pytest.mark.parametrize(
    ("wanted", "words"),
    [
        (route("0.0.0.0/0", "10.0.0.9", "wlan0"), "wlan0 is down"),
        (route("0.0.0.0/0", "192.168.11.100"), "this computer itself"),
        (route("0.0.0.0/0", "172.16.0.1"), "not in a network of eth0"),
        (route("0.0.0.0/0", "192.168.11.255"), "broadcast or multicast"),
        (route("0.0.0.0/0", "224.0.0.1"), "broadcast or multicast"),
        (route("0.0.0.0/0", "192.168.11.1", source="192.168.11.7"), "no address of this computer"),
    ],
)
def test_what_the_kernel_would_refuse_is_said_before(wanted, words):
    with pytest.raises(Problem, match=words):
        route_options.check_usable([route_options.RouteRequest(wanted, "eth0", "auto")], INTERFACES, [])


def test_a_gateway_behind_a_listed_route_or_on_link_is_usable():
    behind = route("0.0.0.0/0", "172.16.0.1")
    near = route("172.16.0.0/24")
    route_options.check_usable([route_options.RouteRequest(r, "eth0", "auto") for r in (behind, near)], INTERFACES, [])
    route_options.check_usable(
        [route_options.RouteRequest(behind._replace(on_link=True), "eth0", "auto")], INTERFACES, []
    )
