# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Routes by networkd on machines with udev: nothing of others is deleted for a moment, and ours come back.

`ip monitor` watches. A quarter of an hour where nothing else runs.
"""

import pytest
import vm
from foreign import SET, Watch
from setups.links import wait_until

FIRST, SECOND = ({"destination": f"10.70.{number}.0/24", "gateway": "192.168.1.5"} for number in (1, 2))
OURS = ["10.70.1.0/24 via 192.168.1.5 dev eth0 proto static", "10.70.2.0/24 via 192.168.1.5 dev eth0 proto static"]
RULES = "ip -4 rule; ip -6 rule; ip route show table 52"


@pytest.fixture(scope="module", params=["bookworm", "trixie"])
def lab(request, new_machines):
    """A machine with two links of networkd, and what others have made there."""
    host = vm.make_host("ana", ["192.168.1.11/24", "10.0.0.1/24"], "networkd", request.param)
    with new_machines(f"machines-{request.param}", [host]) as found:
        found.run("ana", "set -e" + SET.format(first="192.168.1"))
        yield found


def change(lab, *routes):
    status, output = lab.module("ana", "routes", {"routes": list(routes)})
    assert status == 0, output
    return output


def has_ours(lab):
    return OURS[0] in lab.run("ana", "ip route").replace(" \n", "\n").splitlines()


@pytest.mark.parametrize("routes, new", [([FIRST], OURS[:1]), ([FIRST, SECOND], OURS[1:])])
def test_a_change_deletes_nothing_of_others(lab, routes, new):
    with Watch(lab.run, "ana") as watch:
        change(lab, *routes)
    assert (watch.deleted, watch.lost) == ([], [])
    assert [line.strip() for line in watch.new] == new


def test_a_reload_by_somebody_else_finds_nothing_new(lab):
    with Watch(lab.run, "ana") as watch:
        lab.run("ana", "networkctl reload")
    assert (watch.deleted, watch.lost, watch.new) == ([], [], [])


def test_the_routes_come_back_with_the_carrier(lab):
    before = lab.run("ana", RULES)
    lab.set_carrier("ana", "eth0", False)
    wait_until(
        lambda: not lab.run("ana", "ip -br address show eth0 | grep -w 192.168.1.11/24", check=False),
        60,
        "networkd drops the address",
    )
    lab.run("ana", "ip route flush 10.70.0.0/16")
    lab.set_carrier("ana", "eth0", True)
    wait_until(lambda: has_ours(lab), 60, "the route is there again")
    assert lab.run("ana", RULES) == before


def test_a_removal_deletes_ours_alone(lab):
    with Watch(lab.run, "ana") as watch:
        change(lab, FIRST)
    assert [line.strip() for line in watch.lost] == OURS[1:]
    assert len(watch.deleted) == 1 and OURS[1] in watch.deleted[0]


def test_the_routes_are_there_after_a_boot(lab):
    lab.reboot("ana")
    wait_until(lambda: has_ours(lab), 60, "the route is there again")
    assert lab.run("ana", "find /run/systemd -name '*rosfleet*'") == ""
    assert "0 of 1 routes changed" in change(lab, FIRST)
