# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The plan: what each kind of computer gets. The companion of a sealed roscore gets the nodes, and nobody gets a login there."""

from ipaddress import IPv4Address

import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._inventory.read import read_fleet
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan.plan import fleet_plan
from counted import count_lines
from fleets import COMPANION, ONE, SEALED, behind_gateways, fig12, plan, sealed

AT = IPv4Address("192.168.1.40")
EVERY = {"net.ipv4.icmp_echo_ignore_broadcasts": "0", "net.ipv4.conf.all.arp_ignore": "3"}
FORWARDS = {"net.ipv4.ip_forward": "1", "net.ipv4.conf.all.rp_filter": "2"}
NO_REDIRECTS = {f"net.ipv4.conf.{name}.send_redirects": "0" for name in ("all", "default", "{common}")}


def test_the_companion_runs_the_nodes_of_a_sealed_roscore():
    plan = sealed()
    own, master = plan.computers[COMPANION], plan.master_of["hsr"]
    assert own.services == ("address", "watchdog", "discovery", "connections", "sync") and own.is_master
    assert own.environment == {"ROS_MASTER_URI": "http://192.168.1.40:11311", "ROS_IP": "192.168.1.41"}
    assert (own.roscore, [entry.port for entry in own.ports]) == ("sealed", [11511, 11611])
    assert (master.computer, master.name, master.roscore) == (COMPANION, SEALED, AT)
    assert (master.uri, master.monitor_uri) == ("http://192.168.1.40:11311/", "http://192.168.1.41:11611")
    assert own.discovery["interface"] == "192.168.1.41"
    assert plan.computers[ONE].discovery["robot_hosts"] == ["192.168.1.41"]


def test_others_know_a_sealed_computer_by_all_its_names():
    plan = sealed(multimaster_firewall="none")
    assert [(entry.address, entry.names) for entry in plan.hosts_entries][1] == (AT, (SEALED, "hsrb.local"))
    known = plan.belonging.robots[0]
    assert set(known.uris) == {f"http://{host}:11311/" for host in ("192.168.1.40", "hsrb", "hsrb.local")}
    assert known.addresses == (IPv4Address("192.168.1.41"),) and {SEALED, "hsrb.local", str(AT)} <= set(known.hosts)
    assert plan.master_uris["hsr"] == known.uris and AT in plan.belonging.computers


def test_the_plan_says_what_shells_get():
    assert {entry.shells for entry in plan().computers.values()} == {"all"}
    assert {entry.shells for entry in plan(multimaster_shells="names").computers.values()} == {"names"}


def test_nothing_is_planned_on_a_sealed_computer():
    of_sealed = sealed().computers[SEALED]
    assert of_sealed.sealed and not of_sealed.services and not of_sealed.environment and not of_sealed.sysctl
    assert not of_sealed.look_at.parts and not of_sealed.listens
    assert SEALED not in [listener.name for listener in sealed().listeners]


@pytest.mark.parametrize(
    ("computer", "expected"),
    [("tibi-nav", EVERY), ("tibi-visio", {**EVERY, **FORWARDS}), ("router", {**FORWARDS, **NO_REDIRECTS})],
)
def test_each_kind_of_computer_has_its_kernel_settings(computer, expected):
    """The table of docs/start/multi_computer.md says them in words."""
    assert {entry.name: entry.value for entry in fig12().computers[computer].sysctl} == expected


def make_plan(inventory):
    return fleet_plan(read_fleet(inventory))


@pytest.mark.slow
def test_twice_the_computers_are_twice_the_work():
    make_plan(behind_gateways(8))  # what is kept after the first plan
    small, large = (count_lines(make_plan, behind_gateways(computers)) for computers in (96, 192))
    assert large["_inventory"] / small["_inventory"] < 2.1  # all is read and compared
    # Each gateway has a route to each other robot, and each discovery node knows it: pairs of robots.
    assert large["_plan"] / small["_plan"] < 3
    assert sum(large.values()) / sum(small.values()) < 2.3
