# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""A robot that is switched on without its network: one robot per network manager, each booted cold with its plug pulled out.

The order of the tests is that of a day. Losses of minutes: tests/long/test_alone.py.
"""

import time

import pytest
from setups.links import wait_until
from setups.plug import ROBOTS, STATIC, boot_alone, events, expect_seen, moments, plug, wait_for_events

NAME = "systems-alone"
FOREIGN = "192.168.24.77"
ANSWERS, TALKS = 5.0, 5.0  # seconds


@pytest.fixture(scope="module")
def lab():
    with boot_alone(NAME) as found:
        yield found


@pytest.fixture(scope="module")
def booted(slack, lab):
    """The time at which the robots booted: `slack` has measured since then."""
    return time.monotonic()


def test_every_robot_works_alone_at_once(lab, booted, slack):
    for robot in ROBOTS:
        found = wait_for_events(lab, robot, "own topic", "own service", f"online {robot}-pc")
        began, answered = moments(lab, robot, "multimaster-roscore")
        talked = max(found["own topic"], found["own service"]) - answered
        print(f"\n{robot}: its roscore answers after {answered - began:.2f} s, its own nodes talk {talked:.2f} s later")
        assert answered - began <= ANSWERS + slack(booted)
        assert talked <= TALKS + slack(booted)
        assert "address" not in found


def test_services_wait_for_no_network_and_log_once(lab):
    for robot in ROBOTS:
        for unit in ("discovery", "sync"):
            wait_until(lambda: moments(lab, robot, f"multimaster-{unit}")[1], 20, f"{robot}: {unit} is there")  # noqa: B023
    time.sleep(3)
    for robot in ROBOTS:
        jobs = lab.run(f"{robot}-pc", "systemctl list-jobs --no-legend")
        assert "multimaster" not in jobs
        if robot in ("bob", "dan"):  # ifupdown and NetworkManager do not wait for a carrier
            assert "network-online.target" in jobs, "else this boot shows nothing"
        log = lab.run(f"{robot}-pc", "journalctl --boot --output cat --unit 'multimaster-*'")
        assert log.count("waiting for it") <= 2, log
        assert "rror" not in log, log


def test_robots_that_get_their_link_are_there_at_once(lab, slack):
    since = time.monotonic()
    for robot in STATIC:
        plug(lab, robot)
    for robot in STATIC:
        expect_seen(lab, robot, [other for other in STATIC if other != robot], slack, since)


def asked_for(lab, address):
    """The result of ana's kernel for an address by ARP."""
    probe = f"import socket; socket.socket(socket.AF_INET, socket.SOCK_DGRAM).sendto(b'', ('{address}', 9))"
    return lab.run(
        "ana-pc", f'ip neigh flush to {address}; python3 -c "{probe}"; sleep 0.5; ip neigh show to {address}'
    )


def test_a_robot_works_alone_in_a_foreign_network(lab):
    plug(lab, "dan")
    lab.run("dan-pc", f"ip address add {FOREIGN}/24 dev eth0")
    wait_until(lambda: "lladdr" in asked_for(lab, FOREIGN), 10, "dan is in the network, with another address")
    assert "lladdr" not in asked_for(lab, ROBOTS["dan"])
    assert "success: True" in lab.run("dan-pc", "rosservice call /dan/echo")
    assert "online dan-pc" not in events(lab, "ana")
    lab.run("dan-pc", f"ip address del {FOREIGN}/24 dev eth0")


def test_a_robot_whose_address_comes_late_is_there_at_once(lab, slack):
    since = time.monotonic()
    lab.start("ana-pc", "dhcp", f"python3 {{script}} eth0 {ROBOTS['ana']} {ROBOTS['dan']}", "hostile/dhcp_server.py")
    wait_for_events(lab, "dan", "address")
    expect_seen(lab, "dan", STATIC, slack, since)
    wait_for_events(lab, "dan", *(f"online {robot}-pc" for robot in STATIC), *(f"heard {robot}" for robot in STATIC))
    lab.stop("ana-pc", "dhcp")


RESTARTS = {
    "ana": "networking",
    "bob": "systemd-networkd",
    "cid": "NetworkManager",
    "dan": "systemd-networkd",
}


def test_network_managers_leave_the_own_address_alone(lab):
    for robot, manager in RESTARTS.items():
        lab.run(f"{robot}-pc", f"systemctl restart {manager}")
        route = f"local {ROBOTS[robot]} dev lo"
        assert route in lab.run(f"{robot}-pc", "ip route show table local proto 84")


def test_no_service_was_started_again(lab):
    for robot in ROBOTS:
        names = "multimaster-roscore multimaster-discovery multimaster-sync"
        shown = lab.run(f"{robot}-pc", f"systemctl show {names} --property=NRestarts,ActiveState")
        assert shown.split() == ["NRestarts=0", "ActiveState=active"] * 3


def test_another_planned_address_replaces_a_route_until_a_stop(lab):
    """As managed_services does it: when the unit stops, systemd has read the new text already."""
    unit, route = "multimaster-address.service", "ip route show table local proto 84"
    change = f"sed -i 's/{ROBOTS['ana']}/192.168.24.99/g' /etc/systemd/system/{unit}"
    seen = lab.run("ana-pc", f"{change} && systemctl daemon-reload && systemctl restart {unit} && {route}")
    assert seen.split() == "local 192.168.24.99 dev lo scope host metric 84".split()
    assert lab.run("ana-pc", f"systemctl stop {unit} && {route}") == ""
