# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The work for one packet in a large fleet: its packet filter names every computer, and a gateway has a route to every robot."""

from ipaddress import IPv4Address, IPv4Interface, IPv4Network

import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._network.model import (
    Interface,
    Machine,
    Packet,
    Route,
    Rule,
    kernel_routes,
)
from counted import count_lines

PORT = Interface("eth0", (IPv4Interface("10.1.0.1/16"),))


def make_gateway(robots):
    """Make a gateway with a route to each robot, and a rule for each of their computers."""
    networks = [IPv4Network(f"10.2.{number}.0/24") for number in range(robots)]
    routes = [Route(network, IPv4Address("10.1.0.2"), "eth0") for network in networks]
    computers = tuple(IPv4Network(network[1]) for network in networks)
    rules = Rule("in", "accept", sources=computers), Rule("in", "drop")
    return Machine("gateway", (PORT,), (*kernel_routes(PORT), *routes), rules=rules)


@pytest.mark.parametrize("last", [0, 1, 9], ids=["the first", "another", "nobody"])
def test_a_packet_is_the_same_work(last):
    def work(robots):
        gateway, number = make_gateway(robots), {0: 0, 1: robots - 1, 9: 250}[last]
        packet = Packet("tcp", IPv4Address(f"10.2.{number}.1"), IPv4Address(f"10.2.{number}.1"), 11311)

        def send():
            return gateway.route(packet), gateway.find_blocking_rule("in", packet, "eth0")

        route, rule = send()  # what is kept after the first packet
        assert (route is None, rule is None) == (last == 9, last != 9)
        return count_lines(send)

    assert work(8) == work(200)
