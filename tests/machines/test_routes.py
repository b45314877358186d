# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Routes by each network manager on machines with udev: nothing foreign is deleted for a moment, and ours come back.

`ip monitor` watches. About five minutes for each row of ROWS if nothing else runs.
"""

import re

import pytest
import vm
from foreign import SET, Watch
from setups.links import wait_until

FIRST, SECOND = ({"destination": f"10.70.{number}.0/24", "gateway": "192.168.1.5"} for number in (1, 2))
OURS = [f"{route['destination']} via 192.168.1.5 dev eth0 proto static" for route in (FIRST, SECOND)]
RULES = "ip -4 rule; ip -6 rule; ip route show table 52"
# The manager, Debian's release, and a command by which a person lets the manager read its files again. It finds nothing new.
ROWS = [
    ("networkd", "bookworm", "networkctl reload"),
    ("networkd", "trixie", "networkctl reload"),
    ("netplan", "bookworm", "netplan generate && networkctl reload"),
    ("netplan", "trixie", "netplan generate && networkctl reload"),
    ("networkmanager", "bookworm", "nmcli connection reload"),
    ("networkmanager", "trixie", "nmcli connection reload"),
    ("ifupdown", "bookworm", "ifup --all"),
    ("ifupdown", "trixie", "ifup --all"),
]


@pytest.fixture(scope="module", params=ROWS, ids=lambda row: "-".join(row[:2]))
def row(request):
    return request.param


@pytest.fixture(scope="module")
def lab(row, new_machines):
    """A machine with two links, and what other programs and people have made there."""
    manager, suite, _command = row
    host = vm.make_host("ana", ["192.168.1.11/24", "10.0.0.1/24"], manager, suite)
    with new_machines(f"machines-{manager}-{suite}", [host]) as found:
        found.run("ana", "set -e" + SET.format(first="192.168.1"))
        yield found


def change(lab, *routes):
    status, output = lab.module("ana", "routes", {"routes": list(routes)})
    assert status == 0, output
    return output


def strip(lines):
    """Routes without the metric, which NetworkManager chooses."""
    return [re.sub(r" metric \d+", "", line).strip() for line in lines]


def has_ours(lab):
    return OURS[0] in strip(lab.run("ana", "ip route").splitlines())


@pytest.mark.parametrize("routes, new", [([FIRST], OURS[:1]), ([FIRST, SECOND], OURS[1:])])
def test_a_change_deletes_nothing_of_others(lab, routes, new):
    with Watch(lab.run, "ana") as watch:
        change(lab, *routes)
    assert (watch.deleted, watch.lost) == ([], [])
    assert strip(watch.new) == new


def test_a_reload_by_somebody_else_finds_nothing_new(lab, row):
    with Watch(lab.run, "ana") as watch:
        lab.run("ana", row[2])
    assert (watch.deleted, watch.lost, watch.new) == ([], [], [])


def test_the_routes_come_back_with_the_carrier(lab, row):
    before = lab.run("ana", RULES)
    lab.set_carrier("ana", "eth0", False)
    if row[0] != "ifupdown":  # which does not look at a carrier: the address and the routes stay
        wait_until(
            lambda: not lab.run("ana", "ip -br address show eth0 | grep -w 192.168.1.11/24", check=False),
            60,
            "the manager drops the address",
        )
        lab.run("ana", "ip route flush 10.70.0.0/16")
    lab.set_carrier("ana", "eth0", True)
    wait_until(lambda: has_ours(lab), 60, "the route is there again")
    assert lab.run("ana", RULES) == before


def test_a_removal_deletes_ours_alone(lab):
    with Watch(lab.run, "ana") as watch:
        change(lab, FIRST)
    assert strip(watch.lost) == OURS[1:]
    assert len(watch.deleted) == 1 and OURS[1] in watch.deleted[0]


def test_the_routes_are_there_after_a_boot(lab):
    lab.reboot("ana")
    wait_until(lambda: has_ours(lab), 60, "the route is there again")
    assert lab.run("ana", "find /run/systemd -name '*rosfleet*'") == ""
    assert "0 of 1 routes changed" in change(lab, FIRST)
