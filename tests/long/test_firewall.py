# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The packet filter with each of its back ends: what a stranger finds, cold boots, and a robot that joins.

ana has nothing else that filters packets, bob has ufw, cid has firewalld. The order of the tests is that of a day. About
six minutes.
"""

import shutil
from pathlib import Path

import demo
import pytest
import yaml
from proofs.proof import prove, table
from setups.packet_filters import ECHO, NARROW, STRANGER, make_filter_lab

INVENTORY = Path(__file__).with_name("firewall")
FILTERS = {"ana-pc": "nftables", "bob-pc": "ufw", "cid-pc": "firewalld"}


@pytest.fixture(scope="module")
def lab():
    """The robots with the owners' own packet filters."""
    with make_filter_lab("long-firewall", INVENTORY, FILTERS) as found:
        yield found


@pytest.fixture(scope="module")
def two(lab, tmp_path_factory):
    """The first two robots after site.yml; cid is not in the inventory yet. Returns the inventory."""
    inventory = tmp_path_factory.mktemp("fleet") / "inventory"
    shutil.copytree(INVENTORY, inventory)
    groups = yaml.safe_load((inventory / "hosts.yml").read_text())
    del groups["robots"]["children"]["cid"]
    (inventory / "hosts.yml").write_text(yaml.safe_dump(groups))
    lab.inventory = inventory
    status, output = lab.play("site.yml")
    assert status == 0, output
    return inventory


@pytest.fixture(scope="module")
def fleet(lab, two):
    """All three robots after site.yml."""
    shutil.copy(INVENTORY / "hosts.yml", two / "hosts.yml")
    status, output = lab.play("site.yml")
    assert status == 0, output
    return lab


def proofs_pass(lab, *hosts):
    results = prove(demo.person(lab.connection, hosts), lambda _text: None)
    assert all(result.ok for result in results), table(results)


def test_a_robot_that_is_not_in_the_inventory_is_a_stranger(lab, two):
    proofs_pass(lab, "ana-pc", "bob-pc")
    members = [lab.addresses["ana-pc"], lab.addresses["bob-pc"]]
    assert lab.look("cid-pc", *members, **NARROW) == {address: {"tcp": [], "udp": []} for address in members}


def test_a_robot_that_is_added_is_let_in(fleet):
    fleet.lets_members_in()
    proofs_pass(fleet, "ana-pc", "cid-pc")
    proofs_pass(fleet, "bob-pc", "cid-pc")


def test_a_stranger_finds_nothing(fleet):
    fleet.keeps_strangers_out()
    fleet.leaves_ssh_and_pings()


def test_packets_forged_in_a_robots_name_reach_no_port(fleet):
    fleet.takes_nothing_in_its_own_name()


def test_the_fleet_is_green(fleet):
    status, output = fleet.play("playbooks/verify.yml")
    assert status == 0, output
    assert fleet.play_filter("--check", "--diff") == dict.fromkeys(FILTERS, 0)


def test_a_rule_that_somebody_removed_comes_back(fleet):
    fleet.brings_rules_back()


def test_a_cold_boot_keeps_it(fleet):
    fleet.cold_boot(*FILTERS)
    fleet.keeps_strangers_out(**NARROW)
    fleet.leaves_ssh_and_pings()
    assert fleet.play_filter() == dict.fromkeys(FILTERS, 0)


def test_who_is_allowed_is_let_in_by_the_next_run(fleet):
    assert fleet.play_filter(multimaster_allow=["192.168.20.99"]) == dict.fromkeys(FILTERS, 1)
    for found in fleet.look(STRANGER, *fleet.addresses.values(), **NARROW).values():
        assert ECHO in found["tcp"] and ECHO in found["udp"]


BY_HAND = """
iptables -N ENGINE; iptables -A FORWARD -j ENGINE; iptables -I INPUT -p tcp --dport 9 -j DROP
iptables -t nat -A POSTROUTING -s 172.17.0.0/16 -j MASQUERADE; ip6tables -A INPUT -p tcp --dport 9 -j DROP
nft add table inet own; nft 'add chain inet own c { type filter hook input priority 5; }'; nft add rule inet own c tcp dport 9 drop
"""
SEEN = "iptables-save | grep -e ENGINE -e 9 -e 172.17; ip6tables-save | grep 'dport 9'; nft list table inet own"


def test_rules_that_others_made_by_hand_stay(fleet):
    """As those of a container engine: also where firewalld reads its files again."""
    for host in FILTERS:
        fleet.run(host, BY_HAND)
    before = {host: fleet.run(host, f"{SEEN} | grep -v '^[:#]'") for host in FILTERS}
    assert all(text.count("172.17.0.0/16") == 1 and text.count("9") > 3 for text in before.values()), before
    fleet.play_filter(multimaster_allow=["192.168.20.98"])
    assert {host: fleet.run(host, f"{SEEN} | grep -v '^[:#]'") for host in FILTERS} == before


def nothing_is_left(lab):
    lab.has_nothing_of_ours()
    assert "8080/tcp" in lab.shows("bob-pc")
    assert "8080/tcp" in lab.run("cid-pc", "firewall-cmd --list-ports")


def test_without_the_variable_nothing_of_it_is_left(fleet):
    assert fleet.play_filter(multimaster_firewall="none") == dict.fromkeys(FILTERS, 1)
    nothing_is_left(fleet)


def test_a_teardown_takes_it_back(fleet):
    assert fleet.play_filter() == dict.fromkeys(FILTERS, 1)
    status, output = fleet.play("playbooks/teardown.yml")
    assert status == 0, output
    nothing_is_left(fleet)
    assert ECHO in fleet.look(STRANGER, fleet.addresses["ana-pc"], **NARROW)[fleet.addresses["ana-pc"]]["tcp"]
