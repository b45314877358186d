# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The packet filter on real systems, with each of its back ends, seen by a computer that is no robot.

ana has nothing else that filters packets, bob has ufw, cid has firewalld. The order of the tests is that of a day.
"""

import re

import pytest
from filtered import ECHO, ROBOTS, STRANGER, filtered_lab

NOTHING = {address: {"tcp": [], "udp": []} for address in ROBOTS.values()}
NARROW = {"first": 11300, "last": 12000}  # the ports of roscore and discovery, and one that answers everybody
PLAYBOOK = "tests/systems/firewall.yml"
# A rule of ours that somebody removes.
REMOVED = {
    "ana-pc": "nft flush chain inet rosfleet_multimaster input",
    "bob-pc": "ufw --force delete deny proto tcp from 0.0.0.0/0 to any port 1024:65535",
    "cid-pc": "firewall-cmd --policy=rosfleet-input --remove-rich-rule="
    "'rule priority=-1 port port=1024-65535 protocol=tcp drop'",
}


@pytest.fixture(scope="module")
def fleet():
    """The robots after site.yml, with the packet filter."""
    with filtered_lab("systems-firewall") as lab:
        before = lab.look(STRANGER, *ROBOTS.values(), **NARROW)
        assert before[ROBOTS["ana-pc"]] == {"tcp": [ECHO], "udp": [ECHO]}
        status, output = lab.play("site.yml")
        assert status == 0, output
        yield lab


def filters(lab, **variables):
    status, output = lab.play(PLAYBOOK, variables=variables)
    assert status == 0, output
    return {host: int(changed) for host, changed in re.findall(r"(\w+-pc) : ok=\d+ changed=(\d+)", output)}


def test_a_stranger_finds_nothing_and_a_member_everything(fleet):
    assert fleet.look(STRANGER, *ROBOTS.values()) == NOTHING
    members = (("ana-pc", ("bob-pc", "cid-pc")), ("bob-pc", ("ana-pc",)))
    for host, others in members:
        for found in fleet.look(host, *(ROBOTS[other] for other in others), **NARROW).values():
            assert {11311, 11611, ECHO} <= set(found["tcp"]) and ECHO in found["udp"], (host, found)


def test_ssh_and_pings_stay(fleet):
    for address in ROBOTS.values():
        assert "1 received" in fleet.run(STRANGER, f"ping -c 1 -W 2 {address}")
        greeting = f"timeout 5 bash -c 'exec 3<>/dev/tcp/{address}/22; head -c 7 <&3'"
        assert fleet.run(STRANGER, greeting) == "SSH-2.0"


def test_the_fleet_is_green(fleet):
    status, output = fleet.play("playbooks/verify.yml")
    assert status == 0, output
    status, output = fleet.play(PLAYBOOK, "--check", "--diff")
    assert status == 0 and set(re.findall(r"changed=(\d+)", output)) == {"0"}, output


def test_a_rule_that_somebody_removed_comes_back(fleet):
    good = {host: fleet.shows(host) for host in ROBOTS}
    for host, command in REMOVED.items():
        fleet.run(host, command)
        assert fleet.shows(host) != good[host]
    assert filters(fleet) == dict.fromkeys(ROBOTS, 1)
    assert {host: sorted(fleet.shows(host)) for host in ROBOTS} == {host: sorted(text) for host, text in good.items()}


def test_a_cold_boot_keeps_it(fleet):
    for host in ROBOTS:
        fleet.podman("restart", "--time=2", host)
    for host in ROBOTS:
        fleet.wait_until_up(host)
        fleet.echo(host)
    assert fleet.look(STRANGER, *ROBOTS.values(), **NARROW) == NOTHING
    assert filters(fleet) == dict.fromkeys(ROBOTS, 0)


def test_who_is_allowed_is_let_in_by_the_next_run(fleet):
    assert filters(fleet, multimaster_allow=["192.168.20.99"]) == dict.fromkeys(ROBOTS, 1)
    assert all(found["tcp"] for found in fleet.look(STRANGER, *ROBOTS.values(), **NARROW).values())


def test_without_the_variable_nothing_of_it_is_left(fleet):
    assert filters(fleet, multimaster_firewall="none") == dict.fromkeys(ROBOTS, 1)
    left = "ls /etc/rosfleet-multimaster/firewall.nft /etc/systemd/system/multimaster-firewall.service /etc/firewalld/policies/rosfleet-*.xml"
    for host in ROBOTS:
        assert (
            fleet.run(host, f"{left} /var/lib/rosfleet-multimaster/files-firewall.json 2>/dev/null", check=False) == ""
        )
        assert not re.search(r"rosfleet.multimaster|1024", fleet.shows(host))
    assert "8080/tcp" in fleet.shows("bob-pc")
    assert "8080/tcp" in fleet.run("cid-pc", "firewall-cmd --list-ports")
