# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""A robot that is switched on without its network: one robot per network manager, each booted cold with its plug pulled out.

The computers have a plug between eth0 and the lab's network (tests/lab/files/wire), since no container boots without a
carrier else. ana's address (ifupdown) is there without a carrier; bob's and cid's (networkd, NetworkManager) come with the
carrier; dan's (netplan) by a DHCP server that comes late. The order of the tests is that of a day.
"""

import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from links import until
from proof import NODES

NAME = "systems-alone"
INVENTORY = Path(__file__).with_name("alone")
ROBOTS = {"ana": "192.168.24.21", "bob": "192.168.24.22", "cid": "192.168.24.23", "dan": "192.168.24.24"}
STATIC = ("ana", "bob", "cid")
FOREIGN = "192.168.24.77"
ANSWERS, TALKS, SEEN, HEARD = 5.0, 5.0, 2.0, 5.0  # seconds
STARTS = 3  # programs of Python that start within a limit, each half a second of work (tests/lab/busy.py): roscore, its nodes

DHCP = """
network:
  version: 2
  renderer: networkd
  ethernets:
    eth0: {dhcp4: true, accept-ra: false}
"""
# NetworkManager would make a connection of its own for every interface that it finds.
UNMANAGED = "[keyfile]\nunmanaged-devices=interface-name:wire0;interface-name:port0;interface-name:lab0\n"
# Something on a robot always wants the target of the network, and then the service of its manager waits for it.
UNIT = """
[Unit]
Wants=network-online.target
After=multimaster-roscore.service
[Service]
ExecStart=/bin/bash -lc 'exec {command}'
StandardOutput=truncate:/run/{name}.out
Restart=on-failure
[Install]
WantedBy=multi-user.target
"""


@pytest.fixture(scope="module")
def lab(new_lab):
    """The robots after site.yml, and after a cold boot without a network."""
    with new_lab(NAME, INVENTORY) as found:
        status, output = found.play("site.yml")
        assert status == 0, output
        prepare(found)
        with ThreadPoolExecutor(len(ROBOTS)) as pool:
            list(pool.map(lambda robot: found.podman("restart", "--time=5", f"{robot}-pc"), ROBOTS))
        yield found


@pytest.fixture(scope="module")
def booted(slack, lab):
    """When the robots booted: `slack` has measured since then."""
    return time.monotonic()


def prepare(lab):
    """Put the plugs and the robots' own nodes in, for the next boot."""
    for robot, address in ROBOTS.items():
        others = " ".join(other for other in ROBOTS if other != robot)
        commands = {
            "alone": f"python3 /usr/local/share/lab/alone.py {robot} {address} {others}",
            "relay": f"rosrun topic_tools relay /{robot}/talk /{robot}/relayed __name:={robot}_relay",
        }
        files = {"/usr/local/share/lab/alone.py": (NODES / "alone.py").read_text()}
        for name, command in commands.items():
            files[f"/etc/systemd/system/{name}.service"] = UNIT.format(name=name, command=command)
        if robot == "cid":
            files["/etc/NetworkManager/conf.d/lab.conf"] = UNMANAGED
        if robot == "dan":
            files["/etc/netplan/01-lab.yaml"] = DHCP
        for path, text in files.items():
            lab.run(f"{robot}-pc", f"cat > {path}", stdin=text)
        wire = "cp /usr/local/share/lab/wire.service /etc/systemd/system"
        lab.run(f"{robot}-pc", f"{wire} && systemctl --quiet enable wire alone relay")


def events(lab, robot):
    """What a robot's node has told: event -> when."""
    return {event: at for at, event in lab.output(f"{robot}-pc", "alone")}


def told(lab, robot, *expected, seconds=60.0):
    """The same, as soon as these events are among it."""
    what = f"{robot}: {', '.join(expected)}"

    def look():
        found = events(lab, robot)
        return found if set(expected) <= set(found) else None

    return until(look, seconds, what)


def moments(lab, robot, unit):
    """When the start of a unit began and ended, by the steady clock."""
    names = ("InactiveExitTimestampMonotonic", "ActiveEnterTimestampMonotonic")
    shown = lab.run(f"{robot}-pc", f"systemctl show {unit} --property={','.join(names)}")
    of = dict(line.split("=") for line in shown.splitlines())
    return tuple(int(of[name]) / 1e6 for name in names)


def plug(lab, robot):
    lab.run(f"{robot}-pc", "ip link set port0 up")


def expect_seen(lab, robot, others, slack, since):
    """The other robots list this one within the time from the moment when both have their network, and hear its topic."""
    for other in others:
        there = told(lab, other, "address", f"online {robot}-pc", f"heard {robot}")
        both = max(there["address"], told(lab, robot, "address")["address"])
        seen, heard = there[f"online {robot}-pc"] - both, there[f"heard {robot}"] - both
        print(f"{robot} is listed by {other} after {seen:.2f} s, its topic is heard after {heard:.2f} s")
        assert seen <= SEEN + slack(since)
        assert heard <= HEARD + slack(since)


def test_every_robot_works_alone_at_once(lab, booted, slack):
    for robot in ROBOTS:
        found = told(lab, robot, "own topic", "own service", f"online {robot}-pc")
        began, answered = moments(lab, robot, "multimaster-roscore")
        talked = max(found["own topic"], found["own service"]) - answered
        print(f"\n{robot}: its roscore answers after {answered - began:.2f} s, its own nodes talk {talked:.2f} s later")
        assert answered - began <= ANSWERS + STARTS * slack(booted)
        assert talked <= TALKS + STARTS * slack(booted)
        assert "address" not in found


def test_the_services_wait_for_no_network_and_do_not_complain_again_and_again(lab):
    for robot in ROBOTS:
        for unit in ("discovery", "sync"):
            until(lambda: moments(lab, robot, f"multimaster-{unit}")[1], 20, f"{robot}: {unit} is there")  # noqa: B023
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
    """What ana's kernel finds out about an address by ARP."""
    probe = f"import socket; socket.socket(socket.AF_INET, socket.SOCK_DGRAM).sendto(b'', ('{address}', 9))"
    return lab.run(
        "ana-pc", f'ip neigh flush to {address}; python3 -c "{probe}"; sleep 0.5; ip neigh show to {address}'
    )


def test_in_a_foreign_network_a_robot_works_alone_and_answers_for_nobody_else(lab):
    plug(lab, "dan")
    lab.run("dan-pc", f"ip address add {FOREIGN}/24 dev eth0")
    until(lambda: "lladdr" in asked_for(lab, FOREIGN), 10, "dan is in the network, with another address")
    assert "lladdr" not in asked_for(lab, ROBOTS["dan"])
    assert "success: True" in lab.run("dan-pc", "rosservice call /dan/echo")
    assert "online dan-pc" not in events(lab, "ana")
    lab.run("dan-pc", f"ip address del {FOREIGN}/24 dev eth0")


def test_a_robot_whose_address_comes_late_is_there_at_once(lab, slack):
    since = time.monotonic()
    lab.start("ana-pc", "dhcp", f"python3 {{script}} eth0 {ROBOTS['ana']} {ROBOTS['dan']}", "dhcp_server.py")
    told(lab, "dan", "address")
    expect_seen(lab, "dan", STATIC, slack, since)
    told(lab, "dan", *(f"online {robot}-pc" for robot in STATIC), *(f"heard {robot}" for robot in STATIC))
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
