# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Losses of minutes: what tests/systems/test_links.py shows in seconds. Takes twenty minutes."""

import os
import time

import pytest
from setups.links import Watch, chat, cut, lossy, measure_recovery, message_times, repair, wait_until
from subject import three_robots

COMPUTERS = ("ana-pc", "bob-pc", "cid-pc")
PAIRS = (("ana", "bob"), ("bob", "ana"))  # who hears whom
LOSSY_SECONDS = float(os.environ.get("LINKS_LOSSY_SECONDS", "600"))
BACK = {"roscpp": 2.0, "rospy": 5.0}  # seconds from the return of the link to the first message


@pytest.fixture(scope="module")
def lab():
    with three_robots("long-links") as found:
        for here, there in PAIRS:
            chat(found, here, there)
        for here, _there in PAIRS:
            wait_until(lambda here=here: all(message_times(found, here).values()), 60, f"{here} hears")
        yield found


@pytest.fixture(scope="module")
def watches(lab):
    return {host: Watch(lab, host) for host in COMPUTERS}


def test_no_false_removal_while_a_third_of_frames_is_lost(lab, watches):
    since = time.monotonic()
    with lossy(lab, COMPUTERS, 30):
        time.sleep(LOSSY_SECONDS)
    assert {host: watch.removals(since) for host, watch in watches.items()} == dict.fromkeys(COMPUTERS, [])


@pytest.mark.parametrize("away", [70, 320])
def test_messages_come_again_after_minutes(lab, away):
    cut(lab, "bob-pc")
    time.sleep(away)
    back = repair(lab, "bob-pc")
    time.sleep(15)
    seconds = {
        (library, here): round(measure_recovery(times, back, time.monotonic() - 1), 2)
        for here, _there in PAIRS
        for library, times in message_times(lab, here).items()
    }
    print(f"\nmessages again after {away} s:", seconds)
    for (library, here), value in seconds.items():
        assert value <= BACK[library], (library, here, seconds)
