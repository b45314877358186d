# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The packet filter on real systems, seen by a computer that is no robot: robots on which nothing else filters packets.

tests/long/test_firewall.py has ufw and firewalld besides. The order of the tests is that of a day.
"""

import re
from pathlib import Path

import pytest
from setups import forgery
from setups.packet_filters import ECHO, STRANGER, make_filter_lab

INVENTORY = Path(__file__).with_name("firewall")


@pytest.fixture(scope="module")
def fleet():
    """The robots after site.yml, with the packet filter."""
    with make_filter_lab("systems-firewall", INVENTORY, dict.fromkeys(("ana-pc", "bob-pc"), "nftables")) as lab:
        for found in lab.look(STRANGER, *lab.addresses.values(), first=ECHO, last=ECHO).values():
            assert found == {"tcp": [ECHO], "udp": [ECHO]}
        status, output = lab.play("site.yml")
        assert status == 0, output
        yield lab


def test_a_stranger_finds_nothing_and_a_member_everything(fleet):
    fleet.keeps_strangers_out()
    fleet.lets_members_in()
    fleet.leaves_ssh_and_pings()


def test_forged_packets_reach_a_port_only_without_the_filter(fleet):
    """Without it they do, or the test could not fail."""
    fleet.takes_nothing_in_its_own_name()
    address, *_others, local, _loopback, group = fleet.list_own_places("ana-pc")
    packets = [(address, address), ("127.0.0.1", address), (local, local), (local, group)]
    fleet.run("ana-pc", "nft delete table inet rosfleet_multimaster")
    try:
        heard = fleet.forges("ana-pc", *packets)
    finally:
        fleet.run("ana-pc", "systemctl reload multimaster-firewall")
    # Each family has its own socket: which of them is read first is nobody's promise.
    assert sorted(line for line in heard if not line.startswith("itself")) == sorted(
        f"{here} > {there}" for here, there in packets
    )
    fleet.takes_nothing_in_its_own_name()


def test_nothing_comes_in_while_nftables_service_flushes_all(fleet):
    """A stranger sends each 5 ms, in its own name and in that of the robot."""
    own = fleet.addresses["ana-pc"]
    packets = [("192.168.20.99", own), (own, own)]
    attack = forgery.Attack(STRANGER, "ana-pc", "ana-pc", packets, ("bob-pc", own))
    deeds = ("start", "reload", "reload", "restart", "stop")
    words = [f"systemctl {deed} nftables" for deed in deeds] + ["systemctl restart multimaster-firewall"]
    found = forgery.count(fleet, attack, [lambda word=word: fleet.run("ana-pc", word) for word in words])
    assert found.keys() == {"honest", "rounds"} and found["honest"] > 50 and found["rounds"] > 100, found


def test_rules_of_an_earlier_version_are_replaced(fleet):
    """Those without the chain against forged packets, as they were; verify tells until then, on that computer alone."""
    file = "/etc/rosfleet-multimaster/firewall.nft"
    fleet.run("bob-pc", f"sed -i '/chain prerouting/,/}}/d' {file} && nft -f {file}")
    status, output = fleet.play("playbooks/verify.yml")
    assert status != 0 and "Findings: 1. the packet filter of bob-pc is not as planned" in output, output
    assert "FAILED: 1 of " in output and "ana-pc is not as planned" not in output, output
    assert fleet.play_filter() == {"ana-pc": 0, "bob-pc": 1}
    assert fleet.play_filter() == {"ana-pc": 0, "bob-pc": 0}
    fleet.takes_nothing_in_its_own_name()


def test_verify_names_what_the_next_boot_would_miss(fleet):
    fleet.run("ana-pc", "systemctl disable multimaster-firewall")
    status, output = fleet.play("playbooks/verify.yml")
    assert status != 0 and "Findings: 1. the packet filter of ana-pc is not as planned" in output, output
    assert "FAILED: 1 of " in output, output  # with the filter, all else is green
    assert fleet.play_filter() == {"ana-pc": 1, "bob-pc": 0}


def test_a_rule_that_somebody_removed_comes_back(fleet):
    fleet.brings_rules_back()


def test_without_the_variable_nothing_of_it_is_left(fleet):
    assert fleet.play_filter(multimaster_firewall="none") == {"ana-pc": 1, "bob-pc": 1}
    fleet.has_nothing_of_ours()


def test_an_obstacle_stops_its_computer_before_any_change(fleet):
    inactive = "{{ 'ufw' if inventory_hostname == 'bob-pc' else 'auto' }}"
    status, output = fleet.play("site.yml", variables={"firewall_backend": inactive})
    assert status != 0 and "backend is ufw, which is not active here, expected it to filter packets" in output, output
    changed = dict(re.findall(r"(\S+-pc) : ok=\d+ changed=(\d+)", output))
    assert changed["bob-pc"] == "0" and changed["ana-pc"] != "0", output
