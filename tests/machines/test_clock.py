# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Clocks of machines of their own: chrony sets one by a step, and a person sets it wrong, while nodes of ROS run."""

import re
from pathlib import Path

import pytest
from machines.layout import hosts_of, read_inventory
from setups.links import Watch, wait_until

INVENTORY = Path(__file__).with_name("clock")
ANA, BOB = HOSTS = ("ana-pc", "bob-pc")
SOURCE, FOLLOWER = "192.168.1.11", "192.168.1.12"
PATIENCE = 600  # seconds for a program of ROS that starts
NEAR = 0.1  # seconds between two clocks that are the same
HOUR = 3600
STEPPED = re.compile(r".*System clock was stepped by -?3[56]\d\d\.")
UNITS = "multimaster-roscore multimaster-discovery multimaster-sync multimaster-connections multimaster-watchdog"

# Asks the clock of another machine by NTP, past any time service of this one: the best of some answers. Prints how far it is ahead of ours.
ASK = """
import socket, struct, sys, time
found = []
with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
    sock.settimeout(5)
    for _number in range(8):
        sent = time.time()
        sock.sendto(b"\\x23" + bytes(47), (sys.argv[1], 123))
        answer, came = sock.recv(100), time.time()
        taken, given = ((high - 2208988800) + low / 2**32 for high, low in (struct.unpack_from("!II", answer, at) for at in (32, 40)))
        found.append((came - sent, ((taken - sent) + (given - came)) / 2))
print(min(found)[1])
"""


@pytest.fixture(scope="module")
def lab(new_machines):
    """The robots after site.yml. bob's clock was an hour late before."""
    with new_machines("machines-clock", hosts_of(read_inventory(INVENTORY)), INVENTORY) as found:
        found.write(BOB, "/root/ask.py", ASK)
        set_ahead(found, -HOUR)
        status, output = found.play("site.yml")
        assert status == 0, output
        yield found


def set_ahead(lab, seconds):
    """Set bob's clock, so many seconds from where it is."""
    lab.run(BOB, f"python3 -c 'import time; time.clock_settime(time.CLOCK_REALTIME, time.time() + {seconds})'")


def uptime(lab, host):
    return float(lab.run(host, "cat /proc/uptime").split()[0])


def behind(lab):
    """How far bob's clock is behind that of ana, by NTP."""
    return float(lab.run(BOB, f"python3 /root/ask.py {SOURCE}"))


def is_right(lab):
    return abs(behind(lab)) < NEAR


def said(lab, since):
    """(uptime, line): what chronyd on bob has said since an uptime of this boot."""
    lines = lab.run(
        BOB, "journalctl --boot --unit chrony --output short-monotonic --no-hostname --no-pager"
    ).splitlines()
    found = [re.match(r"\[ *([0-9.]+)\] (.*)", line) for line in lines]
    return [(float(match[1]), match[2]) for match in found if match and float(match[1]) >= since]


def test_the_first_site_yml_steps_the_clock_of_a_follower(lab):
    wait_until(lambda: is_right(lab), 60, "bob has the time of ana")
    assert any(STEPPED.match(line) for _at, line in said(lab, 0)), said(lab, 0)


class Fleet:
    """The nodes, their registrations and their restarts while a clock jumps. Times are of the steady clock of each machine."""

    def __init__(self, lab):
        self.lab = lab
        self.watches = {host: Watch(lab, host, looks=2, patience=PATIENCE) for host in HOSTS}
        self.masters = {
            host: Watch(lab, host, looks=2, script="observers/masters.py", patience=PATIENCE) for host in HOSTS
        }
        self.talk("before")

    def talk(self, word):
        """A new topic of each of the two is heard by the other."""
        for here, there in (("ana", "bob"), ("bob", "ana")):
            words = f"{here}_{word} +/{here}/{word} /{there}/{word}"
            self.lab.start(f"{here}-pc", word, f"python3 {{script}} {words}", "programs/chatter.py")
        for host in HOSTS:
            wait_until(lambda host=host: self.lab.output(host, word), PATIENCE, f"{host} hears what is new")

    def losses(self, since):
        """The registrations and robots that a computer has lost."""
        return {
            host: [
                *self.watches[host].removals(since[host]),
                *[
                    text
                    for _at, text in self.masters[host].events(since[host])
                    if text.startswith("-") or "offline" in text
                ],
            ]
            for host in HOSTS
        }

    def hears(self, here, since):
        """True if the program from before has heard the other robot since."""
        return any(at > since[here] for at, _text in self.lab.output(here, "before"))


@pytest.fixture(scope="module")
def fleet(lab):
    """ana and bob talk before any jump."""
    return Fleet(lab)


def running(lab):
    """Process ids, and how often systemd has started something again."""
    return lab.run(BOB, f"systemctl show --property=MainPID,NRestarts {UNITS}")


def heartbeats(lab):
    """The number of bob's heartbeats that ana hears in ten seconds."""
    words = f"-i eth0 -n -l 'udp port 11511 and src host {FOLLOWER}' 2>/dev/null"
    return len(lab.run(ANA, f"timeout 10 tcpdump {words}", check=False).splitlines())


def test_a_jump_by_an_hour_ends_nothing_and_loses_nothing(lab, fleet):
    """A person sets bob's clock an hour ahead, and right again with chrony: a jump there and one back."""
    before, since = running(lab), {host: uptime(lab, host) for host in HOSTS}
    set_ahead(lab, HOUR)
    assert abs(behind(lab) + HOUR) < 60
    assert heartbeats(lab) >= 5  # in a time that is longer than it takes to call a robot lost
    fleet.talk("ahead")
    wait_until(lambda: "wrong by" in str(said(lab, since[BOB])), 120, "chronyd notices")
    lab.run(BOB, "chronyc makestep")  # as the finding says
    wait_until(lambda: is_right(lab), 60, "bob has the time of ana again")
    middle = {host: uptime(lab, host) for host in HOSTS}
    assert heartbeats(lab) >= 5
    for host in HOSTS:
        wait_until(lambda host=host: fleet.hears(host, middle), 60, f"{host} hears what it heard before")
    assert running(lab) == before
    assert fleet.losses(since) == dict.fromkeys(HOSTS, [])
