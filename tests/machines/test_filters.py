# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The packet filter by each program on machines: rules that other programs and people made stay, and ours are there after a boot.

About four minutes for each row of ROWS if nothing else runs.
"""

import pytest
import vm
from foreign import SET, Watch
from setups.links import wait_until

# systemd calls firewalld started when it has its name on the bus; it empties the tables of iptables a moment later.
FIREWALLD = "systemctl unmask firewalld; systemctl enable --now firewalld; until firewall-cmd --state; do sleep 1; done"
# What filters packets before we come, Debian's release, and what shows our rules.
ROWS = {
    ("nftables", "bookworm"): ("true", "nft list ruleset"),
    ("nftables", "trixie"): ("true", "nft list ruleset"),
    ("ufw", "bookworm"): ("ufw allow 22/tcp; ufw --force enable", "iptables-save"),
    ("ufw", "trixie"): ("ufw allow 22/tcp; ufw --force enable", "iptables-save"),
    ("firewalld", "bookworm"): (FIREWALLD, "nft list ruleset"),
    ("firewalld", "trixie"): (FIREWALLD, "nft list ruleset"),
}
# Chains of a container engine, a rule of a person, and a table of another program.
BY_HAND = """set -e
iptables -N ENGINE; iptables -A FORWARD -j ENGINE; iptables -I INPUT -p tcp --dport 9 -j DROP
iptables -t nat -A POSTROUTING -s 172.17.0.0/16 -j MASQUERADE; ip6tables -A INPUT -p tcp --dport 9 -j DROP
nft add table inet own; nft 'add chain inet own c { type filter hook input priority 5; }'; nft add rule inet own c tcp dport 9 drop
"""
SEEN = "(iptables-save; ip6tables-save) | grep -e ENGINE -e 'dport 9' -e 172.17 | grep -v '^:'; nft list table inet own"
MEMBERS = ["192.168.1.12", "192.168.1.13"]


@pytest.fixture(scope="module", params=ROWS, ids="-".join)
def row(request):
    return request.param


@pytest.fixture(scope="module")
def lab(row, new_machines):
    """A machine with a program that filters packets, and what others have made there."""
    host = vm.make_host("ana", ["192.168.1.11/24"], "ifupdown", row[1])
    with new_machines(f"machines-{'-'.join(row)}", [host]) as found:
        found.run("ana", ROWS[row][0])
        found.run("ana", "set -e" + SET.format(first="192.168.1"))
        found.run("ana", BY_HAND)
        yield found


def change(lab, members):
    """Let members in; return the output."""
    status, output = lab.module("ana", "firewall", {"members": members})
    assert status == 0, output
    return output


def names_members(lab, row, members):
    rules = lab.run("ana", ROWS[row][1])
    return [address for address in MEMBERS if address in rules] == members


@pytest.mark.parametrize("members", [MEMBERS[:1], MEMBERS], ids=["first", "change"])
def test_a_change_loses_nothing_of_others(lab, row, members):
    before = lab.run("ana", SEEN)
    assert before.count("172.17.0.0/16") == 1 and before.count("dport 9") == 3, before
    with Watch(lab.run, "ana") as watch:
        output = change(lab, members)
    assert row[0] in output
    assert (watch.deleted, watch.lost, watch.new) == ([], [], [])
    assert lab.run("ana", SEEN) == before
    assert names_members(lab, row, members)


def test_a_boot_brings_ours_back(lab, row):
    lab.reboot("ana")
    wait_until(lambda: names_members(lab, row, MEMBERS), 60, "the rules are there after a boot")
    assert '"changed": false' in change(lab, MEMBERS)


def test_a_removal_takes_ours_alone(lab, row):
    lab.run("ana", BY_HAND)
    before = lab.run("ana", SEEN)
    change(lab, [])
    assert lab.run("ana", SEEN) == before
    assert names_members(lab, row, [])
