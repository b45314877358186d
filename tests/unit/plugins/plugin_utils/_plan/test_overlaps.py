# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Interfaces of a computer in the network of another robot."""

import time
from dataclasses import replace
from ipaddress import IPv4Address, IPv4Network

import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._base.plain import from_plain
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan import overlaps
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan.model import (
    ComputerPlan,
    PlannedRoute,
    RobotNetwork,
)
from mentioned import mentions

PLAN = from_plain(
    ComputerPlan,
    {
        "computer": "tibi-visio",
        "robot": "tibi",
        "address": "192.168.13.1",
        "common_address": "192.168.1.3",
        "network": "192.168.13.0/24",
        "networks": [
            {"network": "192.168.13.0/24", "address": "192.168.13.1"},
            {"network": "192.168.1.0/24", "address": "192.168.1.3"},
        ],
    },
)


def network(robot, third, gateway=1):
    part = f"192.168.{third}"
    gateways = {"gateway": f"{part}.{gateway}", "common_address": f"192.168.1.{third}"}
    return from_plain(RobotNetwork, {"robot": robot, "network": f"{part}.0/24", **gateways})


NETWORKS = (network("dabo", 10), network("helena", 11), network("tibi", 13))


def interface(name, *addresses):
    pairs = [one.split("/") for one in addresses]
    return {"name": name, "addresses": [{"address": one, "prefix": int(size or 24)} for one, size in pairs]}


def route(destination, device, gateway=""):
    return {"destination": destination, "device": device, "gateway": gateway}


OWN = [interface("lo", "127.0.0.1/8"), interface("eth0", "192.168.13.1/24"), interface("eth1", "192.168.1.3/24")]
USUAL = [
    route("0.0.0.0/0", "eth1", "192.168.1.1"),
    route("192.168.13.0/24", "eth0"),
    route("192.168.1.0/24", "eth1"),
    route("192.168.10.0/24", "eth1", "192.168.1.10"),
    route("192.168.11.0/24", "eth1", "192.168.1.11"),
]


def find(*interfaces, routes=(), tables=(), plan=PLAN, networks=NETWORKS):
    info = {"interfaces": [*OWN, *interfaces], "routing": {"routes": [*USUAL, *routes], "tables": tables}}
    return overlaps.find_overlaps(plan, networks, info)


def test_a_machine_like_its_plan_has_none():
    assert find() == [] and overlaps.describe_overlaps(PLAN, []) == []


def test_a_bridge_with_another_robots_network_is_named_with_both_names():
    found = find(interface("br0", "192.168.10.1/24"), routes=[route("192.168.10.0/24", "br0")])
    (sentence,) = overlaps.describe_overlaps(PLAN, found)
    assert mentions(sentence, "tibi-visio", "br0", "192.168.10.1/24", "dabo", "192.168.10.0/24")
    assert len(found) == 1  # the kernel's own route of the address is no second one


@pytest.mark.parametrize(
    ("interfaces", "routes", "tables", "expected"),
    [
        # docker's network is larger, smaller, or the same
        ([("docker0", "192.168.0.1/20")], [], [], ["dabo", "helena"]),
        ([("virbr0", "192.168.11.129/25")], [], [], ["helena"]),
        # a second address of a planned interface
        ([("eth1", "192.168.10.77/24")], [], [], ["dabo"]),
        # the end of a tunnel
        ([("wg0", "192.168.10.9/32")], [], [], ["dabo"]),
        # a VPN leads there: in the main table, and in one of its own that a rule asks first
        ([], [("192.168.10.0/24", "tun0")], [], ["dabo"]),
        ([], [], [("192.168.11.64/26", "tailscale0")], ["helena"]),
        # a wider route counts behind the planned one, in whatever order
        ([], [("192.168.0.0/16", "tun0"), ("0.0.0.0/1", "tun0")], [], []),
        # no way, and other networks
        ([], [("192.168.10.0/24", "")], [], []),
        ([("docker0", "172.17.0.1/16"), ("wlan0", "fe80::1/64")], [("172.17.0.0/16", "docker0")], [], []),
    ],
)
def test_what_leads_into_the_network_of_another_robot(interfaces, routes, tables, expected):
    held = [{"table": "52", "routes": [route(*one) for one in tables]}] if tables else []
    found = find(*(interface(*one) for one in interfaces), routes=[route(*one) for one in routes], tables=held)
    assert sorted(one.robot for one in found) == expected


def test_a_planned_address_in_a_network_that_is_too_large_has_a_check_of_its_own():
    info = {"interfaces": [interface("eth1", "192.168.1.3/16")], "routing": {"routes": []}}
    assert overlaps.find_overlaps(PLAN, NETWORKS, info) == []


def test_a_router_may_be_the_gateway_of_a_robot():
    router = {"computer": "router", "address": "192.168.1.1", "common_address": "192.168.1.1", "is_router": True}
    plan = from_plain(ComputerPlan, {**router, "network": "192.168.1.0/24"})
    routes = [route("192.168.10.0/24", "eth2")]  # the kernel's own route of the address

    def find_there(address):
        info = {"interfaces": [interface("eth1", "192.168.1.1/24"), interface("eth2", address)]}
        return overlaps.find_overlaps(plan, NETWORKS, {**info, "routing": {"routes": routes}})

    assert find_there("192.168.10.1/24") == []
    assert [one.interface for one in find_there("192.168.10.2/24")] == ["eth2"]


ROUTED = replace(
    PLAN,
    routes=tuple(PlannedRoute(IPv4Network(f"192.168.{one}.0/24"), IPv4Address(f"192.168.1.{one}")) for one in (10, 11)),
)


@pytest.mark.parametrize(
    ("owned", "routes", "expected"),
    [
        # the run takes its own routes away: a tunnel ends, or the common network is at another interface now
        (["files-tunnel"], [("192.168.10.0/24", "multimaster0", "10.99.0.10")], []),
        (["routes"], [("192.168.10.0/24", "wlan0", "192.168.1.10")], []),
        # nothing was set up, so it is somebody else's; and so is one without a gateway
        ([], [("192.168.10.0/24", "tun0", "10.8.0.1")], ["dabo"]),
        (["routes"], [("192.168.10.0/24", "tun0", "")], ["dabo"]),
        # all routes of the plan are there, so another one is not the collection's
        (
            ["routes"],
            [
                ("192.168.10.0/24", "eth1", "192.168.1.10"),
                ("192.168.11.0/24", "eth1", "192.168.1.11"),
                ("192.168.10.0/24", "tun0", "10.8.0.1"),
            ],
            ["dabo"],
        ),
    ],
)
def test_a_route_of_an_earlier_plan_is_no_reason_against_the_next_one(owned, routes, expected):
    main = [route(*one) for one in routes]
    info = {"owned": owned, "interfaces": OWN, "routing": {"routes": main, "tables": []}}
    assert [one.robot for one in overlaps.find_overlaps(ROUTED, NETWORKS, info)] == expected


def test_a_wider_network_counts_behind_a_planned_route():
    assert (
        find(interface("eth5", "192.168.200.3/16"), interface("eth6", "192.168.8.1/22"), plan=ROUTED) == []
    )  # at its end, too
    assert [one.robot for one in find(interface("eth5", "192.168.10.9/16"), plan=ROUTED)] == ["dabo"]


def test_the_place_is_where_that_network_is_changed():
    places = {
        name: overlaps.Overlap(name, "", PLAN.network, "dabo").place
        for name in ("docker0", "br-0123456789ab", "virbr0")
    }
    assert "daemon.json" in places["docker0"] and "daemon.json" in places["br-0123456789ab"]
    assert places["virbr0"] == "virsh net-edit"


def test_thousands_of_interfaces_take_no_time_and_are_told_in_one_line():
    many = [interface(f"veth{number}", f"192.168.10.{number % 250 + 1}/24") for number in range(2000)]
    networks = [*(network(f"robot{number}", number) for number in range(14, 250)), *NETWORKS]
    began = time.monotonic()
    found = find(*many, networks=networks, routes=[route("10.0.0.0/24", "tun0")] * 5000)
    assert time.monotonic() - began < 20 and len(found) == 2000
    (sentence,) = overlaps.describe_overlaps(PLAN, found)
    assert "and 1996 more" in sentence and len(sentence) < 900


def test_a_name_that_tells_something_stands_in_quotes():
    (sentence,) = overlaps.describe_overlaps(PLAN, find(interface("x; all is well", "192.168.10.1/24")))
    assert '"x; all is well" has' in sentence
