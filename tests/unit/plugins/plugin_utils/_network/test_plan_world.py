# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""In the world of a plan every packet that the fleet needs arrives, and takes the planned way."""

from dataclasses import replace
from ipaddress import IPv4Address

import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._network.model import Rule
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._network.packets import echo
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._network.plan_world import make_world
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan.model import COMMON
from worlds import COMPUTERS, fig12, ping, tcp

from tests.simulator.multicast import send_to_group
from tests.simulator.state import simulate

FLEETS = {
    "fig12": {},
    "networks": {"multimaster_routes": "networks"},
    "existing": {"multimaster_routes": "existing"},
    "packet filter": {"multimaster_firewall": "fleet", "multimaster_firewall_ports": ["51820/udp"]},
    "no router": {"routers": ()},
    "router of another make": {"routers": (), "multimaster_router": "192.168.1.1"},
}


@pytest.mark.parametrize("name", FLEETS)
def test_every_computer_reaches_every_other_one(name):
    plan = fig12(**FLEETS[name])
    world = make_world(plan)
    for one in world.machines:
        for member in plan.members:
            for packet in (ping(member.address, size=1500, whole=True), tcp(member.address, 45000)):
                assert echo(world, one, packet).ok, (one, member.name, packet)


def test_packets_take_the_planned_way():
    world = make_world(fig12())
    way = echo(world, "tibi-nav", ping("192.168.10.100"))
    assert [hop.machine for hop in way.there.hops] == ["tibi-nav", "tibi-visio", "dabo-visio", "dabo-nav"]
    assert [hop.machine for hop in way.back.hops] == ["dabo-nav", "dabo-visio", "tibi-visio", "tibi-nav"]
    crossed = [world.machines[hop.machine].interface(hop.device).link for hop in way.there.hops[:-1]]
    assert crossed == ["the network of tibi", COMMON, "the network of dabo"]
    assert way.there.packet.source == IPv4Address("192.168.11.100")
    assert echo(world, "tibi-visio", ping("192.168.10.100")).there.packet.source == IPv4Address("192.168.1.201")


TUNNEL = {
    "routers": (),
    "multimaster_tunnel": "wireguard",
    "multimaster_transport": "unicast",
    "multimaster_firewall": "fleet",
    "multimaster_tunnel_hub": "kobuki",
}


def test_packets_of_a_tunnel_take_the_way_by_its_hub():
    plan = fig12({"kobuki": {"multimaster_endpoint": "172.16.0.1"}}, **TUNNEL)
    world = make_world(plan)
    way = echo(world, "tibi-nav", ping("192.168.10.100"))
    assert [hop.machine for hop in way.there.hops] == ["tibi-nav", "tibi-visio", "kobuki", "dabo-visio", "dabo-nav"]
    assert all(echo(world, one, ping(member.address)).ok for one in world.machines for member in plan.members)
    docker = replace(world.machines["kobuki"], rules=(Rule("forward", "drop", "icmp"),))
    assert echo(world.replace_machine(docker), "tibi-nav", ping("192.168.10.100")).failure.where == "kobuki"


def test_the_gateway_may_be_a_device_of_another_make():
    world = make_world(fig12({"tibi": {"multimaster_gateway": "192.168.11.1"}}))
    way = echo(world, "tibi-nav", ping("192.168.10.100"))
    assert [hop.machine for hop in way.there.hops] == ["tibi-nav", "192.168.11.1", "dabo-visio", "dabo-nav"]
    assert way.ok and not world.machines["tibi-visio"].find_interface(IPv4Address("192.168.1.201"))


def test_the_group_stays_on_its_network_unless_it_is_routed():
    heard = {}
    for routing in ("none", "smcroute"):
        world = simulate(fig12(multimaster_multicast_routing=routing))
        datagram = tcp("239.255.0.1", 11511)
        heard[routing] = {
            entry.machine for entry in send_to_group(world, "kobuki", IPv4Address("192.168.1.229"), datagram)
        }
        inner = {entry.machine for entry in send_to_group(world, "tibi-visio", IPv4Address("192.168.1.201"), datagram)}
        assert ("tibi-nav" in inner) == (routing == "smcroute")  # the gateway passes on what it sends itself
    assert heard["none"] == {"tibi-visio", "dabo-visio", "router"}
    assert heard["smcroute"] == set(COMPUTERS) - {"kobuki"} | {"router"}


def test_the_planned_packet_filter_keeps_others_out():
    world = make_world(fig12(multimaster_firewall="fleet", multimaster_firewall_ports=["51820/udp"]))
    kobuki = world.machines["kobuki"]
    stranger = IPv4Address("192.168.1.77")
    assert kobuki.find_blocking_rule("in", tcp("192.168.1.229", 11311, source=stranger)).verdict == "drop"
    assert kobuki.find_blocking_rule("in", tcp("192.168.1.229", 22, source=stranger)) is None
    assert kobuki.find_blocking_rule("in", tcp("192.168.1.229", 40000, source=stranger, answer=True)) is None
    gateway = world.machines["tibi-visio"]
    assert gateway.find_blocking_rule("forward", tcp("192.168.11.100", 11311, source=stranger)).verdict == "drop"
