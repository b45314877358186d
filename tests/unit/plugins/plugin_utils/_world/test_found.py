# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The world that was read of machines is the one that they are in; and what site.yml makes of it."""

import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._world.found import (
    after,
    found,
    looked_at,
    makes_sense,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._world.model import Rule, connected
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._world.packets import echo
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._world.planned import COMMON, planned
from worlds import COMPUTERS, change, change_interface, fig12, info_of, ping

PLAN = fig12()
WORLD = planned(PLAN)
ADDRESSES = {str(member.address): member.name for member in PLAN.members}


def infos(world, **more):
    return {name: info_of(world.machines[name], **more) for name in PLAN.computers}


def reached(world):
    return {
        (one, other) for one in COMPUTERS for address, other in ADDRESSES.items() if echo(world, one, ping(address)).ok
    }


BARE = planned(fig12({"tibi": {"multimaster_routes": "existing"}}))


def bare():
    """The machines before site.yml has ever run: no routes, no forwarding."""
    world = WORLD
    for machine in WORLD.machines.values():
        routes = [route for one in machine.interfaces for route in connected(one)]
        world = change(world, machine.name, routes=tuple(routes))
        for one in machine.interfaces:
            world = change_interface(world, machine.name, one.name, forwarding=False, rp_filter=1)
    return world


def test_what_is_read_is_where_packets_go():
    world = found(PLAN, infos(WORLD))
    assert reached(world) == reached(WORLD)
    assert {one.link for machine in world.machines.values() for one in machine.interfaces} == set(WORLD.links)


def test_new_machines_reach_neighbours_before_site_yml():
    now = found(PLAN, infos(bare()))
    assert ("tibi-nav", "tibi-visio") in reached(now) and ("tibi-nav", "dabo-nav") not in reached(now)
    assert reached(after(PLAN, now, infos(bare()))) == {(one, other) for one in COMPUTERS for other in COMPUTERS}


def test_what_site_does_not_change_stays():
    world = change(bare(), "tibi-visio", rules=(Rule("forward", "drop", "icmp"),))
    later = after(PLAN, found(PLAN, infos(world)), infos(world))
    assert echo(later, "tibi-nav", ping("192.168.10.100")).failed.where == "tibi-visio"


def test_who_was_not_looked_at_is_as_planned():
    read = {"tibi-nav": info_of(bare().machines["tibi-nav"])}
    assert found(PLAN, read).machines["dabo-nav"] == WORLD.machines["dabo-nav"]
    assert not looked_at({}) and not looked_at({"interfaces": []})


def test_the_packet_filter_is_found_by_its_record():
    plan = fig12(multimaster_firewall="fleet")
    world = planned(plan)
    for owned, rules in (((), 0), (("files-firewall",), len(world.machines["kobuki"].rules))):
        read = {"kobuki": {**info_of(WORLD.machines["kobuki"]), "owned": list(owned)}}
        now = found(plan, read)
        assert len(now.machines["kobuki"].rules) == rules
        assert after(plan, now, read).machines["kobuki"].rules == world.machines["kobuki"].rules


def test_two_planned_networks_on_one_interface_are_one_wire():
    world = WORLD
    gateway = info_of(world.machines["tibi-visio"])
    inner, common = gateway["interfaces"]
    gateway["interfaces"] = [{**inner, "addresses": inner["addresses"] + common["addresses"]}]
    gateway["routing"]["routes"] = [{**entry, "device": inner["name"]} for entry in gateway["routing"]["routes"]]
    now = found(PLAN, {**infos(world), "tibi-visio": gateway})
    assert reached(now) == reached(WORLD)


def test_a_network_outside_the_fleet_is_a_link_of_its_own():
    read = info_of(WORLD.machines["kobuki"])
    docker = {"name": "docker0", "up": True, "loopback": False, "mtu": 1500}
    read["interfaces"].append({**docker, "addresses": [{"address": "172.17.0.1", "prefix": 16, "family": "inet"}]})
    links = [one.link for one in found(PLAN, {"kobuki": read}).machines["kobuki"].interfaces]
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
    assert makes_sense(PLAN, "kobuki", read)
    assert not makes_sense(PLAN, "kobuki", {**read, **strange})
