# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""What containers hide, on a pair of machines beside what others have made there: the first site.yml, a boot, the way back.

The only file of this folder of which `make test` runs a part: four minutes if nothing else runs, and one and a half for the disk.
"""

from pathlib import Path

import pytest
from foreign import SET, Watch
from machines.layout import hosts_of, read_inventory
from setups.links import wait_until

INVENTORY = Path(__file__).with_name("pair")
GATE, BOB = HOSTS = ("ana-gate", "bob-pc")
OURS = "192.168.11.0/24 via 192.168.20.21 dev eth0 proto static"
OF_ROSCORE = " proto 84 "  # the address that the unit of the roscore makes, and removes
# What each file holds, and where each link points to; others write these two files at a boot.
STATE = (
    "for folder in /etc /var/lib/rosfleet-multimaster; do [ ! -d $folder ] ||"
    r" find $folder -type f ! -name adjtime ! -name .pwd.lock -exec sha256sum {} + -o -type l -printf '%p -> %l\n'; done | sort"
)


@pytest.fixture(scope="module")
def lab(new_machines):
    """The machines before any site.yml, with addresses, routes and rules of other programs."""
    with new_machines("machines-pair", hosts_of(read_inventory(INVENTORY)), INVENTORY) as found:
        for number, host in enumerate(HOSTS):
            found.run(host, "set -e" + SET.format(first="192.168.20").replace(".99/", f".{98 + number}/"))
        yield found


@pytest.fixture(scope="module")
def before(lab):
    found = {host: lab.run(host, STATE).splitlines() for host in HOSTS}
    assert all(found.values())
    return found


def play(lab, name):
    status, output = lab.play(name)
    assert status == 0, output
    return output


def test_the_first_site_yml_deletes_nothing_of_others(lab, before):
    with Watch(lab.run, GATE) as gate, Watch(lab.run, BOB) as bob:
        play(lab, "site.yml")
    for watch in (gate, bob):
        assert (watch.deleted, watch.lost) == ([], [])
    assert [line.strip() for line in bob.new] == [OURS]
    assert gate.new == []


def test_all_is_there_after_a_boot(lab):
    lab.reboot(BOB)
    wait_until(lambda: OURS in lab.run(BOB, "ip route"), 60, "the route is there again")
    assert "PASSED" in play(lab, "playbooks/verify.yml")


@pytest.mark.costly
def test_a_teardown_takes_back_ours_alone(lab, before):
    with Watch(lab.run, GATE) as gate:
        play(lab, "playbooks/teardown.yml")
    assert [line for line in gate.deleted if OF_ROSCORE not in line] == []
    assert (gate.lost, gate.new) == ([], [])
    assert OURS not in lab.run(BOB, "ip route")
    assert {host: lab.run(host, STATE).splitlines() for host in HOSTS} == before
