# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The packet filter in the multi-computer layout: gateways with each back end, and the router, protect what is behind them.

About six minutes.
"""

from pathlib import Path

import demo
import pytest
from proofs.proof import prove, table
from setups.packet_filters import ECHO, STRANGER, make_filter_lab

ROOT = Path(__file__).resolve().parents[2]

INVENTORY = ROOT / "tests" / "long" / "gateways"
GATES = {"ana-gate": "192.168.20.21", "bob-gate": "192.168.20.22", "cid-gate": "192.168.20.23"}
INNER = {"ana-arm": "192.168.11.2", "bob-arm": "192.168.12.2", "cid-arm": "192.168.13.2"}
FILTERS = {**dict.fromkeys([*GATES, *INNER], "nftables"), "bob-gate": "ufw", "cid-gate": "firewalld"}
NARROW = {"first": 11900, "last": 12000}  # with the port that answers everybody
TABLE_GONE = "nft delete table inet rosfleet_multimaster"
# A gateway that filters nothing any more, and the way back to what its owner had.
OFF = {"ana-gate": TABLE_GONE, "bob-gate": "ufw disable", "cid-gate": "systemctl stop firewalld"}
ON = {"bob-gate": "ufw --force enable", "cid-gate": "systemctl start firewalld"}


def nothing(addresses):
    return {address: {"tcp": [], "udp": []} for address in addresses}


def everything(addresses):
    return {address: {"tcp": [ECHO], "udp": [ECHO]} for address in addresses}


def ways(lab, gateways):
    """The stranger's ways into the robots' networks: the next hop of each."""
    for inner, gateway in zip(INNER.values(), gateways, strict=True):
        lab.run(STRANGER, f"ip route replace {inner} via {gateway}")


@pytest.fixture(scope="module")
def lab():
    """The robots after site.yml. Before it, gateways forward nothing, and inner computers answer nobody outside."""
    with make_filter_lab("long-gateways", INVENTORY, FILTERS) as found:
        status, output = found.play("site.yml")
        assert status == 0, output
        ways(found, GATES.values())
        yield found


def test_a_stranger_finds_nothing_and_a_member_everything(lab):
    addresses = [*GATES.values(), *INNER.values()]
    assert lab.look(STRANGER, *addresses) == nothing(addresses)
    others = [INNER["bob-arm"], INNER["cid-arm"]]
    for found in lab.look("ana-arm", *others, **NARROW).values():
        assert found["tcp"] == [ECHO] and found["udp"] == [ECHO]


def test_the_fleet_is_green(lab):
    status, output = lab.play("playbooks/verify.yml")
    assert status == 0, output
    results = prove(demo.person(lab.connection, INNER), lambda _text: None)
    assert all(result.ok for result in results), table(results)


def test_each_filter_on_the_way_keeps_strangers_out_by_itself(lab):
    """From the inside outwards, what is nearer is taken away."""
    inner, router = list(INNER.values()), "192.168.20.1"
    for host in INNER:
        lab.run(host, TABLE_GONE)
    assert lab.look(STRANGER, *inner, **NARROW) == nothing(inner)  # the gateways' forward chains
    for host, command in OFF.items():
        lab.run(host, command)
    assert lab.look(STRANGER, *inner, **NARROW) == everything(inner)
    ways(lab, [router] * 3)
    assert lab.look(STRANGER, *inner, **NARROW) == nothing(inner)  # the router's
    lab.run("router", TABLE_GONE)
    assert lab.look(STRANGER, *inner, **NARROW) == everything(inner)
    ways(lab, GATES.values())

    for host, command in ON.items():
        lab.run(host, command)
    assert lab.play_filter() == {**dict.fromkeys([*INNER, "ana-gate", "router"], 1), "bob-gate": 0, "cid-gate": 0}
    # What the stranger has talked to by UDP a moment ago is a connection that is there already.
    assert not any(found["tcp"] for found in lab.look(STRANGER, *GATES.values(), *inner, **NARROW).values())


def test_a_cold_boot_of_the_gateways_keeps_it(lab):
    lab.cold_boot(*GATES)
    for host in INNER:
        lab.run(host, TABLE_GONE)
    addresses = [*GATES.values(), *INNER.values()]
    assert lab.look(STRANGER, *addresses, **NARROW) == nothing(addresses)
    for address in GATES.values():
        assert "1 received" in lab.run(STRANGER, f"ping -c 1 -W 2 {address}")  # the way is there
    assert all(found["tcp"] == [ECHO] for found in lab.look("ana-arm", *list(INNER.values())[1:], **NARROW).values())


def test_a_teardown_takes_it_back(lab):
    status, output = lab.play("playbooks/teardown.yml")
    assert status == 0, output
    for host in (*GATES, *INNER, "router"):
        assert "rosfleet" not in lab.run(host, "nft list ruleset; ls /etc/firewalld/policies 2>/dev/null; true"), host
    assert "rosfleet" not in lab.run("bob-gate", "cat /etc/ufw/user.rules; ufw status")
    assert lab.look(STRANGER, GATES["ana-gate"], **NARROW) == everything([GATES["ana-gate"]])
