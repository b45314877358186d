# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Clocks of machines of their own: chrony sets them by a step or by their speed, and a person sets them an hour wrong.

Nodes of ROS and the dead-man's switch run meanwhile. The order of the tests is that of a day. A quarter of an hour if nothing else runs.
"""

import json
import re
import time
from pathlib import Path

import pytest
from machines import virtual
from machines.layout import hosts_of, read_inventory
from setups.links import Watch, wait_until

INVENTORY = Path(__file__).with_name("clock")
ANA, BOB = HOSTS = ("ana-pc", "bob-pc")
SOURCE, FOLLOWER = "192.168.1.11", "192.168.1.12"
PATIENCE = 600  # seconds for a program of ROS that starts
NEAR = 0.1  # seconds between two clocks that are the same
HOUR = 3600
OFFSET, SPEED = 0.3, 0.1  # seconds, and the part of a second by which chronyd makes one shorter at most
STEPPED = re.compile(r".*System clock was stepped by -?3[56]\d\d\.")
UNITS = "multimaster-roscore multimaster-discovery multimaster-sync multimaster-connections multimaster-watchdog"
# The lab's way in comes from the last address of the network: this route leads the answers to nobody.
CUT = {"destination": "192.168.1.254/32", "gateway": "192.168.1.5"}
SWITCH = "/run/rosfleet-multimaster/rollback-routes"

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
# Prints how far the clock is ahead of one whose speed nothing changes, each tenth of a second: "TIME AHEAD", the best of some looks.
PACE = """
import time
def raw():
    return time.clock_gettime(time.CLOCK_MONOTONIC_RAW)
while True:
    looks = [(raw(), time.time(), raw()) for _number in range(5)]
    first, clock, last = min(looks, key=lambda look: look[2] - look[0])
    print(f"{(first + last) / 2:.4f} {clock - (first + last) / 2:.5f}", flush=True)
    time.sleep(0.1)
"""
# Returns when the route is away; prints the uptime until which it was to stay, and that at which it was away.
AWAIT = f"""
read -r until <{SWITCH}/until
while read -r now rest </proc/uptime; [ -n "$(ip route show {CUT["destination"].partition("/")[0]})" ]; do sleep 0.2; done
echo "$until $now"
"""


@pytest.fixture(scope="module")
def lab(new_machines):
    """The robots after site.yml. bob's clock was an hour late before."""
    with new_machines("machines-clock", hosts_of(read_inventory(INVENTORY)), INVENTORY) as found:
        found.write(BOB, "/root/ask.py", ASK)
        found.write(BOB, "/root/pace.py", PACE)
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


def samples(lab):
    """How many answers of the source chronyd on bob reckons with."""
    return int(lab.run(BOB, f"chronyc -n -c sourcestats | grep ^{SOURCE},").split(",")[1])


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


def test_a_boot_with_a_wrong_clock_starts_the_nodes_with_the_right_one(lab):
    """The clock of the hardware is an hour ahead."""
    virtual.cut_power(lab.name, BOB)
    virtual.give_power(lab.name, BOB, "-rtc", time.strftime("base=%Y-%m-%dT%H:%M:%S", time.gmtime(time.time() + HOUR)))
    (step,) = (at for at, line in said(lab, 0) if STEPPED.match(line))
    units = "multimaster-roscore multimaster-discovery"
    started = lab.run(BOB, f"systemctl show --value --property=ExecMainStartTimestampMonotonic {units}").split()
    assert len(started) == 2 and all(int(number) / 1e6 > step for number in started), (step, started)
    wait_until(lambda: is_right(lab), 60, "bob has the time of ana")


def ahead(lab):
    """(time, how far bob's clock is ahead then): the looks of PACE."""
    return [(at, float(text)) for at, text in lab.output(BOB, "pace")]


def test_a_small_offset_is_corrected_by_the_speed_of_the_clock_alone(lab):
    wait_until(lambda: samples(lab) > 6, PATIENCE, "chronyd is past its first answers")
    lab.start(BOB, "pace", "python3 /root/pace.py")
    wait_until(lambda: ahead(lab), PATIENCE, "a first look at the clocks")
    right, began = ahead(lab)[-1][1], uptime(lab, BOB)
    set_ahead(lab, OFFSET)
    wait_until(lambda: ahead(lab)[-1][1] > right + OFFSET / 2, 60, "the clock is wrong")
    wait_until(lambda: ahead(lab)[-1][1] < right + OFFSET / 4, 120, "the clock is right again")
    lab.stop(BOB, "pace")
    looks = ahead(lab)
    wrong = next(number for number, (_at, far) in enumerate(looks) if far > right + OFFSET / 2)
    after = list(zip(looks[wrong:], looks[wrong + 1 :]))
    speeds = [(late - early, far - near) for (early, near), (late, far) in after]
    assert all(abs(change) < SPEED * seconds + 0.01 for seconds, change in speeds), speeds
    assert sum(change < -0.02 * seconds for seconds, change in speeds) >= 10, (
        speeds
    )  # it went slower in many of the looks
    assert not [line for _at, line in said(lab, began) if "stepped" in line]


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


@pytest.mark.parametrize("seconds", [HOUR, -HOUR], ids=["forward", "back"])
def test_a_jump_by_an_hour_ends_nothing_and_loses_nothing(lab, fleet, seconds):
    """A person sets bob's clock wrong, and right again with chrony: a jump there and one back."""
    before, since = running(lab), {host: uptime(lab, host) for host in HOSTS}
    set_ahead(lab, seconds)
    assert abs(behind(lab) + seconds) < 60
    assert heartbeats(lab) >= 5  # in a time that is longer than it takes to call a robot lost
    fleet.talk("ahead" if seconds > 0 else "late")
    wait_until(lambda: "wrong by" in str(said(lab, since[BOB])), 120, "chronyd notices")
    lab.run(BOB, "chronyc makestep")  # as the finding says
    wait_until(lambda: is_right(lab), 60, "bob has the time of ana again")
    middle = {host: uptime(lab, host) for host in HOSTS}
    assert heartbeats(lab) >= 5
    for host in HOSTS:
        wait_until(lambda host=host: fleet.hears(host, middle), 60, f"{host} hears what it heard before")
    assert running(lab) == before
    assert fleet.losses(since) == dict.fromkeys(HOSTS, [])


@pytest.mark.parametrize("seconds", [HOUR, -HOUR], ids=["forward", "back"])
def test_a_dead_mans_switch_fires_neither_early_nor_never(lab, seconds):
    words = (BOB, "-m", "rosfleet.multimaster.routes", "-a", json.dumps({"routes": [CUT], "confirm_within": 60}))
    with lab.controller("ansible", *words):
        wait_until(lambda: lab.run(BOB, f"cat {SWITCH}/until", check=False).strip().isdigit(), 600, "the switch waits")
        set_ahead(lab, seconds)
        until, away = map(float, lab.run(BOB, AWAIT, timeout=900).split())
    assert until <= away < until + 30
    set_ahead(lab, -seconds)
    status, output = lab.module(BOB, "routes", {"routes": []})
    assert status == 0 and "of an earlier run, not confirmed within" in output, output


def test_the_fleet_is_well_at_the_end(lab):
    lab.run(BOB, "chronyc makestep")
    status, output = lab.play("playbooks/verify.yml")
    assert status == 0 and "PASSED" in output, output
