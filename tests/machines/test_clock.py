# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""A follower's clock that is an hour late, on a machine with a clock of its own: chrony sets it by a step."""

import re
from pathlib import Path

import pytest
from machines.layout import hosts_of, read_inventory
from setups.links import wait_until

INVENTORY = Path(__file__).with_name("clock")
BOB, SOURCE = "bob-pc", "192.168.1.11"
NEAR, HOUR = 0.1, 3600  # seconds
STEPPED = re.compile(r".*System clock was stepped by 3[56]\d\d\.")

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
        found.run(BOB, f"date --set='-{HOUR} seconds' >/dev/null")
        status, output = found.play("site.yml")
        assert status == 0, output
        yield found


def behind(lab):
    """How far bob's clock is behind that of ana, by NTP."""
    return float(lab.run(BOB, f"python3 /root/ask.py {SOURCE}"))


def is_right(lab):
    return abs(behind(lab)) < NEAR


def test_the_first_site_yml_steps_the_clock_of_a_follower(lab):
    wait_until(lambda: is_right(lab), 60, "bob has the time of ana")
    said = lab.run(BOB, "journalctl --boot --unit chrony --output cat --no-pager")
    assert any(STEPPED.match(line) for line in said.splitlines()), said
