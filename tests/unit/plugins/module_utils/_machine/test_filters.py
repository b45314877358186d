# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Rules of nftables and of iptables, as the kernel holds them and nft prints them, in a network namespace of their own."""

import json
import subprocess

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._base.commands import Answer
from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine import filters

HEAD = "add table ip t; "
CHAIN = "add chain ip t c { type filter hook forward priority 0; policy drop; }; "


def read(script, program="nft -f -", told=filters.chains):
    """The answer about the rules that a script makes."""
    run = ["unshare", "--net", "sh", "-ec", f"{program}; nft -j list ruleset"]
    done = subprocess.run(run, input=script, capture_output=True, text=True, check=True)
    return told(json.loads(done.stdout))


RULES = {
    "accept": {"verdict": "accept"},
    "ip protocol icmp counter drop": {"verdict": "drop", "protocol": "icmp"},
    "meta l4proto udp reject": {"verdict": "reject", "protocol": "udp"},
    "icmp type echo-request drop": {"verdict": "drop", "protocol": "icmp", "state": "new"},
    "udp dport 11511 drop": {"verdict": "drop", "protocol": "udp", "ports": [11511, 11511]},
    "tcp dport 1024-65535 ct state new drop": {
        "verdict": "drop",
        "protocol": "tcp",
        "ports": [1024, 65535],
        "state": "new",
    },
    "ct state established,related accept": {"verdict": "accept", "state": "answer"},
    "ip saddr 192.168.11.0/24 ip daddr 192.168.10.1 accept": {
        "verdict": "accept",
        "sources": ["192.168.11.0/24"],
        "destinations": ["192.168.10.1/32"],
    },
    "ip daddr { 192.168.1.0/24, 10.0.0.1 } drop": {
        "verdict": "drop",
        "destinations": ["10.0.0.1/32", "192.168.1.0/24"],
    },
    "ip length > 1000 drop": {"verdict": "drop", "above": 1000},
    "meta length >= 1000 drop": {"verdict": "drop", "above": 999},
    "iifname != lo tcp dport 11311 drop": {"verdict": "drop", "protocol": "tcp", "ports": [11311, 11311]},
    "iifname eth0 oifname docker0 accept": {"verdict": "accept", "incoming": "eth0", "leaving": "docker0"},
}
STRANGE = (
    "tcp dport { 22, 80 } accept",
    "ip length < 100 drop",
    'iifname "eth*" drop',
    "iifname != eth0 drop",
    "ip saddr != 192.168.1.0/24 drop",
    "ip protocol esp drop",
    "ct state invalid drop",
    "limit rate 5/second accept",
)


@pytest.mark.root
@pytest.mark.parametrize("rule", RULES)
def test_simple_rules_are_read(rule):
    rules = [{**RULES[rule], "chain": "c"}]
    expected = {"hook": "forward", "table": "ip t", "policy": "drop", "rules": rules, "unread": 0, "chain": "c"}
    assert read(f"{HEAD}{CHAIN}add rule ip t c {rule}") == [expected]


@pytest.mark.root
@pytest.mark.parametrize("rule", STRANGE)
def test_others_are_counted(rule):
    assert read(f"{HEAD}{CHAIN}add rule ip t c {rule}; add rule ip t c accept")[0]["unread"] == 1


@pytest.mark.root
def test_chains_are_read_in_the_place_of_the_jump():
    (chain,) = read(
        f"{HEAD}{CHAIN}add chain ip t d; add rule ip t d udp dport 11511 drop; add rule ip t d return; "
        "add rule ip t c iifname eth0 jump d; add rule ip t c accept"
    )
    assert chain["rules"] == [
        {"verdict": "drop", "chain": "d", "protocol": "udp", "ports": [11511, 11511], "incoming": "eth0"},
        {"verdict": "accept", "chain": "c"},
    ]
    assert chain["unread"] == 0


@pytest.mark.root
def test_a_return_that_is_not_the_end_is_not_understood():
    (chain,) = read(f"{HEAD}{CHAIN}add rule ip t c iifname eth0 return; add rule ip t c accept")
    assert (chain["rules"], chain["unread"]) == ([{"verdict": "accept", "chain": "c"}], 1)


@pytest.mark.root
def test_a_circle_of_contradicting_jumps_ends():
    chains = read(
        f"{HEAD}{CHAIN}add chain ip t d; add rule ip t c iifname eth0 jump d; add rule ip t d iifname eth1 drop; add rule ip t d drop"
    )
    assert (chains[0]["rules"], chains[0]["unread"]) == ([{"verdict": "drop", "chain": "d", "incoming": "eth0"}], 1)


@pytest.mark.root
def test_rules_that_drop_nothing_are_left_out():
    own = "add table inet rosfleet_multimaster; add chain inet rosfleet_multimaster input { type filter hook input priority 0; policy drop; }; "
    assert read(own + HEAD + "add chain ip t c { type filter hook input priority 0; }") == []


@pytest.mark.root
def test_masquerading_of_iptables():
    lines = "iptables -t nat -A POSTROUTING -s 172.17.0.0/16 -o eth1 -j MASQUERADE; iptables -P FORWARD DROP"
    found = {chain["hook"]: chain for chain in read("", f"cat >/dev/null; {lines}")}
    assert found["forward"]["policy"] == "drop" and not found["forward"]["rules"]
    told = found["postrouting"]
    rule = {"verdict": "masquerade", "chain": "POSTROUTING", "sources": ["172.17.0.0/16"], "leaving": "eth1"}
    assert (
        told["rules"] == [rule] or told["unread"] == 1
    )  # some versions of nft print the target of iptables as no verdict


@pytest.mark.root
def test_a_translated_target_as_of_docker_is_no_filter():
    jump = "-m addrtype --dst-type LOCAL -j DOCKER"
    lines = f"iptables -t nat -N DOCKER; iptables -t nat -A OUTPUT ! -d 127.0.0.0/8 {jump}; iptables -t nat -A DOCKER -p tcp --dport 80 -j DNAT --to 172.17.0.2"
    own = "add table inet own; add chain inet own out { type filter hook output priority 0; }; add rule inet own out tcp dport 11311 drop"
    assert [chain["table"] for chain in read(own, f"{lines}; nft -f -")] == ["inet own"]
    dropping = HEAD + "add chain ip t c { type nat hook output priority 0; policy drop; }; "
    (told,) = read(dropping + "add rule ip t c tcp dport 80 redirect to 8080")
    assert (told["policy"], told["unread"]) == ("drop", 0)


@pytest.mark.parametrize("output", [b"", b"[]", b"{}", b'{"nftables": [{"rule": {}}]}', b'{"nftables": 3}'])
def test_a_strange_form_is_not_readable(output, monkeypatch):
    monkeypatch.setattr(filters, "run", lambda *_words, **_more: Answer(0, output, ""))
    assert filters.filters() == {"readable": False, "chains": [], "arp": []}


ARP = {
    "arp operation request drop": True,
    "arp operation reply counter drop": True,
    "log drop": True,
    "arp saddr ip 10.0.0.9 drop": False,
    "arp operation request arp daddr ip 10.0.0.9 drop": False,
    "arp operation request accept": False,
    "limit rate over 5/second drop": False,
    "arp saddr ip 10.0.0.9 drop; add rule arp t c arp operation request drop": True,
    "arp saddr ip 10.0.0.9 accept; add rule arp t c drop": False,
}


@pytest.mark.root
@pytest.mark.parametrize("hook", ["input", "output"])
@pytest.mark.parametrize("rule", ARP)
def test_what_drops_arp_of_all_computers_is_found(rule, hook):
    chain = f"add table arp t; add chain arp t c {{ type filter hook {hook} priority 0; }}; "
    assert read(f"{chain}add rule arp t c {rule}", told=filters.find_arp_filters) == (["arp t"] if ARP[rule] else [])


@pytest.mark.root
@pytest.mark.parametrize(("rule", "found"), [("", ["arp t"]), ("add rule arp t c arp saddr ip 10.0.0.9 accept", [])])
def test_a_policy_that_drops_arp_is_found(rule, found):
    chain = "add table arp t; add chain arp t c { type filter hook input priority 0; policy drop; }; "
    assert read(chain + rule, told=filters.find_arp_filters) == found
