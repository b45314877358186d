# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Foreign addresses, routes and rules that a change has lost: compared, and put back on a real kernel."""

import json
import os
import subprocess
import sys
from pathlib import Path

import ansible_collections
import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.transaction import transaction
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.transaction.network import (
    state as network_state,
)
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.transaction.network.state import (
    NetworkItem,
    Snapshot,
)
from ansible_collections.rosfleet.multimaster.plugins.module_utils._base.problem import Problem
from mentioned import mentions

COLLECTIONS = Path(next(iter(ansible_collections.__path__))).parent
SECOND = NetworkItem("address", 4, "10.0.0.9/24 dev eth0 scope global")
LINK = NetworkItem("route", 4, "unicast 172.17.0.0/16 dev eth0 table main proto boot scope link")
BEHIND = NetworkItem("route", 4, "unicast 10.5.0.0/16 via 172.17.0.1 dev eth0 table main proto static scope global")
RULE = NetworkItem("rule", 4, "not from all fwmark 0xca6c lookup 51820 priority 32764")


def snapshot(*items, links=("lo", "eth0"), unseen=None):
    return Snapshot(list(items), list(links), unseen or {})


def test_what_is_gone_is_put_back_in_the_order_in_which_it_needs_each_other():
    before = snapshot(RULE, BEHIND, LINK, SECOND)
    assert network_state.find_missing(before, snapshot()) == [SECOND, LINK, BEHIND, RULE]
    assert network_state.find_missing(before, snapshot(RULE, LINK)) == [SECOND, BEHIND]
    assert network_state.find_missing(before, before) == []
    assert network_state.from_json(json.loads(json.dumps(before.to_json()))) == before


def test_what_went_with_its_interface_is_not_missing():
    assert network_state.find_missing(snapshot(RULE, BEHIND, SECOND), snapshot(links=["lo"])) == [RULE]


@pytest.mark.parametrize(
    ("unseen", "missing"),
    [("route 4", [RULE]), ("rule 4", [BEHIND]), ("route 6", [BEHIND, RULE]), ("4 in part", [BEHIND, RULE])],
)
def test_what_could_not_be_looked_at_is_not_missing(unseen, missing):
    assert network_state.find_missing(snapshot(BEHIND, RULE), snapshot(unseen={unseen: "a sentence."})) == missing


def test_an_item_never_takes_the_place_of_another():
    other = BEHIND._replace(text=BEHIND.text.replace("172.17.0.1", "172.17.0.2"))
    lines = network_state.plan_batches([BEHIND], snapshot(BEHIND, RULE))
    assert lines == {("route", 4): f"route add {BEHIND.text}\n"}
    lines = network_state.plan_batches([BEHIND], snapshot(BEHIND, other))
    assert lines == {("route", 4): f"route append {BEHIND.text}\n"}


def test_routes_are_read_without_what_comes_back_by_itself():
    lines = [
        "unicast 10.0.0.0/24 dev eth0 table main proto kernel scope link src 10.0.0.1",
        "unicast default via 10.0.0.1 dev eth0 table main proto dhcp scope global src 10.0.0.9 metric 100",
        "unicast 10.8.0.0/16 via 10.0.0.2 dev eth0 table main proto bird scope global linkdown ",
        "unicast default via fe80::1 dev eth0 table main proto static metric 5 expires 1799sec pref medium",
        "throw 10.9.0.0/16 table 52 proto boot scope global",
        "unicast 10.7.0.0/16 table main proto static scope global \\\tnexthop via 10.0.0.2 dev eth0 weight 1 \\\tnexthop via 10.0.0.3 dev eth1 weight 1 ",
        "",
    ]
    assert [item.text for item in network_state.parse_routes(lines, 4)] == [
        "unicast default via fe80::1 dev eth0 table main proto static metric 5 pref medium",
        "throw 10.9.0.0/16 table 52 proto boot scope global",
        "unicast 10.7.0.0/16 table main proto static scope global nexthop via 10.0.0.2 dev eth0 weight 1 nexthop via 10.0.0.3 dev eth1 weight 1",
        "unicast 10.8.0.0/16 via 10.0.0.2 dev eth0 table main proto bird scope global",
    ]


def test_what_cannot_be_put_back_is_one_sentence_each():
    sentences = network_state.list_sentences([RULE] * 30)
    assert sentences[0].endswith(f'is gone: put it back by "ip -4 rule add {RULE.text}".')
    assert len(sentences) == 11 and sentences[-1] == "20 more of them are gone."


def test_nobody_says_as_before_without_a_look(monkeypatch):
    monkeypatch.setattr(
        network_state.commands, "run", lambda argv, **_: network_state.commands.Answer(-1, b"", "no ip")
    )
    watch = network_state.StateWatch()

    def fail():
        raise Problem("It breaks.")

    with pytest.raises(Problem) as problem:
        transaction.carry_out([watch.step, transaction.Step("x", fail)])
    assert "could not be looked at" in str(problem.value) and "Everything" not in str(problem.value)
    assert mentions(watch.finish(), "IPv6", "looked")


SETTING_UP = """
    ip link set lo up; ip link add eth0 type bridge; ip link set eth0 up; ip address add 10.0.0.1/24 dev eth0
    ip address add 10.0.0.9/24 dev eth0; ip address add 10.1.1.1 peer 10.1.1.2 dev eth0; ip -6 address add fd00::9/64 dev eth0 nodad
    ip route add 172.17.0.0/16 dev eth0; ip route add 10.5.0.0/16 via 172.17.0.1 proto static mtu lock 1400; ip route add 10.6.0.0/16 via 10.0.0.3 proto bird
    ip route add default via 10.0.0.3 table 100; ip route add throw 10.9.0.0/16 table 52; ip -6 route add fd01::/64 via fd00::1
    ip route append 10.4.0.0/16 via 10.0.0.3; ip route append 10.4.0.0/16 via 10.0.0.4
    for n in $(seq 70); do echo "route add 10.200.$n.0/24 via 10.0.0.3 proto bird"; done | ip -batch -
    ip -6 route add default via fd00::1 table 100 metric 7; ip route add 10.7.0.0/16 nexthop via 10.0.0.3 weight 1 nexthop via 10.0.0.4 weight 2
    ip rule add not fwmark 0xca6c table 51820; ip rule add table main suppress_prefixlength 0; ip rule add from 10.1.0.0/16 iif no0 lookup 100
    ip rule add fwmark 0x80000/0xff0000 unreachable priority 5250; ip -6 rule add from fd00::/64 lookup 100
"""
LOSING = """
    ip -4 rule flush; ip rule add lookup main pref 32766; ip rule add lookup default pref 32767; ip -6 rule del from fd00::/64 lookup 100
    ip address flush dev eth0; ip address add 10.0.0.1/24 dev eth0; ip route flush table 100; ip route flush table 52
"""
ROUTES = "for v in 4 6; do ip -$v route show table all | grep -v -e fe80 -e ff00 -e anycast | sort; done"
STATE = f"ip -4 rule; ip -6 rule; {ROUTES}; ip -o address | grep -v fe80 | sort"
PROGRAM = """
import os, subprocess, sys
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.transaction.network import state as network_state
from ansible_collections.rosfleet.multimaster.plugins.module_utils._base import commands
commands.MOST = int(sys.argv[2])
before = network_state.from_json(network_state.read(network_state.MOST).to_json())
subprocess.run(["sh", "-c", sys.argv[1]], check=True)
print(network_state.put_back(before, lambda item: False))
"""
as_root = pytest.mark.skipif(os.geteuid() != 0, reason="needs root, to make network namespaces")


def in_namespace(losing, most=1 << 22):
    """The state before and after, and what was said, in a network namespace of its own."""
    script = f'{SETTING_UP}\n({STATE}); echo =; "$1" -c "$2" "$3" {most} || exit 1; echo =; {STATE}'
    command = ["unshare", "--net", "sh", "-c", script, "sh", sys.executable, PROGRAM, losing]
    environment = {**os.environ, "PYTHONPATH": str(COLLECTIONS)}
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False, env=environment)
    assert done.returncode == 0, done.stderr
    return [part.strip() for part in done.stdout.split("\n=\n")]


@as_root
def test_all_that_others_made_comes_back():
    before, said, after = in_namespace(LOSING)
    assert sorted(after.splitlines()) == sorted(before.splitlines()), said
    assert said.endswith(", [])")


@as_root
def test_what_has_its_place_meanwhile_stays():
    taken = f"{LOSING}ip address add 10.0.0.9/24 dev eth0; ip route add default via 10.0.0.9 table 100"
    _before, said, after = in_namespace(taken)
    assert "default via 10.0.0.9 dev eth0 table 100" in after and "default via 10.0.0.3" not in after
    assert "put it back by" in said and "ip -4 route add unicast default via 10.0.0.3 dev eth0 table 100" in said


@as_root
def test_very_many_routes_are_compared_in_part_and_it_is_said():
    before, said, after = in_namespace(
        "ip route del 10.5.0.0/16; ip route del 10.6.0.0/16 proto bird; ip route flush table 100", 4500
    )
    assert mentions(said, "boot", "static")
    gone = set(before.splitlines()) - set(after.splitlines())
    assert len(gone) == 1 and "proto bird" in gone.pop()


RULESET = """
table inet rosfleet_multimaster {
    chain input {
        type filter hook input priority filter; policy accept;
        udp dport 9 drop
    }
}
table ip filter {
    set known {
        type ipv4_addr
        elements = { 10.0.0.1,
                 10.0.0.2 }
    }
    chain ufw-user-input {
        tcp dport 7 counter accept
    }
    chain INPUT {
        type filter hook input priority filter; policy drop;
        ip saddr @known tcp dport { 22, 80 } accept
    }
}
"""


def test_of_the_packet_filter_the_rules_of_others_are_read():
    items = network_state.parse_filter(RULESET.split("\n"))
    assert [item.command for item in items] == [
        "nft add chain ip filter INPUT { type filter hook input priority filter; policy drop; }",
        "nft add rule ip filter INPUT ip saddr @known tcp dport { 22, 80 } accept",
    ]
    assert network_state.plan_batches(items, snapshot(*items)) == {}
    assert network_state.find_missing(snapshot(*items), snapshot(items[0], links=[])) == items[1:]
    assert "put it back by" in network_state.list_sentences(items)[0]
