# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The world that was read of machines is the one that they are in; and what site.yml makes of it."""

import itertools
import random
from dataclasses import replace
from ipaddress import IPv4Interface

import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._network.facts import (
    apply_plan,
    join_world,
    read_machines,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._network.model import Rule, kernel_routes
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._network.packets import echo
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._network.plan_world import make_world
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan.model import COMMON
from worlds import COMPUTERS, change, change_interface, fig12, info_of, ping

PLAN = fig12()
WORLD = make_world(PLAN)
ADDRESSES = {str(member.address): member.name for member in PLAN.members}


def infos(world, **more):
    return {name: info_of(world.machines[name], **more) for name in PLAN.computers}


def read_world(plan, read):
    return join_world(plan, read_machines(plan, read))


def reached(world):
    return {
        (one, other) for one in COMPUTERS for address, other in ADDRESSES.items() if echo(world, one, ping(address)).ok
    }


def bare():
    """The machines before site.yml has ever run: no routes, no forwarding."""
    world = WORLD
    for machine in WORLD.machines.values():
        routes = [route for one in machine.interfaces for route in kernel_routes(one)]
        world = change(world, machine.name, routes=tuple(routes))
        for one in machine.interfaces:
            world = change_interface(world, machine.name, one.name, forwarding=False, rp_filter=1)
    return world


def test_what_is_read_is_where_packets_go():
    world = read_world(PLAN, infos(WORLD))
    assert reached(world) == reached(WORLD)
    assert {one.link for machine in world.machines.values() for one in machine.interfaces} == set(WORLD.links)


def test_new_machines_reach_neighbours_before_site_yml():
    now = read_world(PLAN, infos(bare()))
    assert ("tibi-nav", "tibi-visio") in reached(now) and ("tibi-nav", "dabo-nav") not in reached(now)
    assert reached(apply_plan(PLAN, now, infos(bare()))) == {(one, other) for one in COMPUTERS for other in COMPUTERS}


def test_a_tunnel_that_is_not_there_yet_is_used_after_site_yml():
    """Before it, no computer has an address in the common network; then every robot reaches every other one."""
    plan = fig12(
        {name: {"multimaster_endpoint": f"172.16.0.{n}"} for n, name in enumerate(("tibi", "dabo", "kobuki"), 1)},
        routers=(),
        multimaster_tunnel="wireguard",
        multimaster_transport="unicast",
        multimaster_firewall="fleet",
    )
    seen = {}
    for name, machine in make_world(plan).machines.items():
        inner = tuple(one for one in machine.interfaces if one.link != COMMON)
        routes = tuple(route for one in inner for route in kernel_routes(one))
        seen[name] = info_of(replace(machine, interfaces=inner, routes=routes), owned=[])
    now = read_world(plan, seen)
    assert all(one[:3] == other[:3] for one, other in reached(now))
    # dabo-nav and tibi-nav have their default routes by site.yml as well.
    assert reached(apply_plan(plan, now, seen)) == {(one, other) for one in COMPUTERS for other in COMPUTERS}


def test_what_site_does_not_change_stays():
    world = change(bare(), "tibi-visio", rules=(Rule("forward", "drop", "icmp"),))
    later = apply_plan(PLAN, read_world(PLAN, infos(world)), infos(world))
    assert echo(later, "tibi-nav", ping("192.168.10.100")).failure.where == "tibi-visio"


def test_who_was_not_looked_at_is_as_planned():
    read = {"tibi-nav": info_of(bare().machines["tibi-nav"])}
    assert read_world(PLAN, read).machines["dabo-nav"] == WORLD.machines["dabo-nav"]
    assert not read_machines(PLAN, {"tibi-nav": {}}) and not read_machines(PLAN, {"tibi-nav": {"interfaces": []}})


def test_the_packet_filter_is_found_by_its_record():
    plan = fig12(multimaster_firewall="fleet")
    world = make_world(plan)
    for owned, rules in (((), 0), (("files-firewall",), len(world.machines["kobuki"].rules))):
        read = {"kobuki": {**info_of(WORLD.machines["kobuki"]), "owned": list(owned)}}
        now = read_world(plan, read)
        assert len(now.machines["kobuki"].rules) == rules
        assert apply_plan(plan, now, read).machines["kobuki"].rules == world.machines["kobuki"].rules


def test_two_planned_networks_on_one_interface_are_one_wire():
    world = WORLD
    gateway = info_of(world.machines["tibi-visio"])
    inner, common = gateway["interfaces"]
    gateway["interfaces"] = [{**inner, "addresses": inner["addresses"] + common["addresses"]}]
    gateway["routing"]["routes"] = [{**entry, "device": inner["name"]} for entry in gateway["routing"]["routes"]]
    now = read_world(PLAN, {**infos(world), "tibi-visio": gateway})
    assert reached(now) == reached(WORLD)


def addresses_of(*addresses):
    return [
        {"address": address, "prefix": int(prefix), "family": "inet"}
        for address, _slash, prefix in (text.partition("/") for text in addresses)
    ]


@pytest.mark.parametrize("seed", range(30))
def test_links_with_shared_interfaces_are_one_wire(seed):
    draw, read = random.Random(seed), infos(WORLD)
    networks = ["192.168.1.77/24", "192.168.10.77/24", "192.168.11.77/24"]
    pairs = draw.sample(list(itertools.combinations(networks, 2)), 2)
    for name, pair in zip(draw.sample(COMPUTERS, 2), pairs, strict=True):
        draw.choice(read[name]["interfaces"])["addresses"] = addresses_of(*draw.sample(pair, 2))
    now = read_world(PLAN, read)
    assert {one.link for machine in now.machines.values() for one in machine.interfaces} == {COMMON}


@pytest.mark.parametrize(
    ("network", "lost"),
    [
        # that of another robot: the answers to a computer that has only an address there are lost, too
        ("192.168.10.1/24", {("tibi-nav", "dabo-nav"), ("tibi-nav", "dabo-visio"), ("dabo-nav", "tibi-nav")}),
        ("172.17.0.1/16", set()),
    ],
)
def test_a_bridge_with_the_network_of_another_robot_does_not_lead_there(network, lost):
    """As a bridge of containers, whose ports nobody of the robot is at."""
    read = infos(WORLD)
    facts = read["tibi-nav"]
    bridge = {**facts["interfaces"][0], "name": "docker0", "addresses": addresses_of(network)}
    facts["interfaces"] = [*facts["interfaces"], bridge]
    settings = facts["forwarding"]["interfaces"]
    facts["forwarding"] = {**facts["forwarding"], "interfaces": [*settings, {**settings[0], "interface": "docker0"}]}
    route = next(entry for entry in facts["routing"]["routes"] if not entry["gateway"])
    place = {
        "destination": str(IPv4Interface(network).network),
        "device": "docker0",
        "source": network.partition("/")[0],
    }
    facts["routing"] = {**facts["routing"], "routes": [*facts["routing"]["routes"], {**route, **place}]}
    assert reached(WORLD) - reached(read_world(PLAN, read)) == lost


def test_an_outside_address_leaves_an_interface_on_its_link():
    read = infos(WORLD)
    interface = read["kobuki"]["interfaces"][0]
    interface["addresses"] = addresses_of("10.9.0.1/24") + interface["addresses"]
    now = read_world(PLAN, read)
    assert now.machines["kobuki"].interfaces[0].link == COMMON and reached(now) == reached(WORLD)


def test_a_network_outside_the_fleet_is_a_link_of_its_own():
    read = info_of(WORLD.machines["kobuki"])
    docker = {"name": "docker0", "up": True, "loopback": False, "mtu": 1500}
    read["interfaces"].append({**docker, "addresses": [{"address": "172.17.0.1", "prefix": 16, "family": "inet"}]})
    links = [one.link for one in read_world(PLAN, {"kobuki": read}).machines["kobuki"].interfaces]
    assert links == [COMMON, "docker0 of kobuki"]


@pytest.mark.parametrize(
    "strange",
    [
        {"interfaces": [3]},
        {"routing": {"routes": [{"destination": "x"}]}},
        {"filters": {"chains": [{"hook": "elsewhere"}]}},
        {"forwarding": {"interfaces": None}},
        {"routing": []},
    ],
)
def test_what_makes_no_sense_is_told_apart(strange):
    read = info_of(WORLD.machines["kobuki"])
    assert read_machines(PLAN, {"kobuki": read})
    assert not read_machines(PLAN, {"kobuki": {**read, **strange}})
