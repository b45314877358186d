# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""Counters of packets that were given up, as the kernel and nft print them."""

from ansible_collections.rosfleet.multimaster.plugins.module_utils._follow import counters

SNMP = """Ip: Forwarding DefaultTTL InHdrErrors OutNoRoutes
Ip: 1 64 55 2
Icmp: InMsgs OutTimeExcds
Icmp: 9 16
"""
RULES = """table ip filter {
    chain INPUT {
        type filter hook input priority filter; policy accept;
        tcp dport 11311 counter packets 3 bytes 180 drop
        ip saddr 10.0.0.1 counter packets 7 bytes 420 accept
    }
}
table inet fleet {
    chain forward {
        ct state new counter packets 2 bytes 120 reject
        tcp dport 22 drop
    }
}
"""


def test_tables_of_names_and_numbers_are_read():
    found = counters.read_table(SNMP, counters.TABLES["/proc/net/snmp"])
    assert found == {"IpInHdrErrors": 55, "IpOutNoRoutes": 2, "IcmpOutTimeExcds": 16}
    assert counters.read_table("", counters.TABLES["/proc/net/snmp"]) == {}


def test_rules_that_refuse_and_count_are_named_by_their_place():
    assert counters.read_ruleset(RULES) == {
        "rule of filter INPUT: tcp dport 11311 drop": 3,
        "rule of fleet forward: ct state new reject": 2,
    }


def test_connections_and_interfaces_are_summed_up():
    tracks = (
        "entries searched found new invalid ignore delete drop early_drop insert_failed\n" + "0 0 0 0 a 0 0 1 0 2\n" * 2
    )
    assert counters.read_tracks(tracks) == {
        "conntrack drop": 2,
        "conntrack early_drop": 0,
        "conntrack insert_failed": 4,
        "conntrack invalid": 20,
    }
    devices = "head\nhead\n  eth0: 1 2 3 4 0 0 0 0 5 6 7 8 0 0 0 0\n    lo: 1 2 3 4 0 0 0 0 5 6 7 8 0 0 0 0\n"
    assert counters.read_devices(devices) == {
        "eth0 errors in": 3,
        "eth0 drops in": 4,
        "eth0 errors out": 7,
        "eth0 drops out": 8,
    }


def test_only_what_has_grown_is_told():
    assert counters.find_growth({"a": 1, "b": 2}, {"a": 1, "b": 5, "c": 4, "d": 0}) == {"b": 3, "c": 4}
