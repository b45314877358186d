# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Minutes without a network: what tests/systems/test_alone.py shows in seconds, here with addresses instead of names.

Takes six minutes.
"""

import os
import time

import pytest
from proofs.busy import Busy
from setups.links import Watch, chat, message_times, wait_until
from setups.plug import ROBOTS, STATIC, boot_alone, expect_seen, plug, wait_for_events

ALONE_SECONDS = float(os.environ.get("ALONE_SECONDS", "180"))
LOST_SECONDS = 40.0
OFFLINE_AFTER = 5.0
SERVICES = "multimaster-roscore multimaster-discovery multimaster-sync"


@pytest.fixture(scope="module")
def slack():
    with Busy() as busy:
        yield busy.slack


@pytest.fixture(scope="module")
def lab():
    with boot_alone("long-alone", multimaster_advertise="address") as found:
        for robot in STATIC:
            wait_for_events(found, robot, "own topic", "own service", f"online {robot}-pc")
        yield found


def expect_no_restart(lab):
    for robot in STATIC:
        shown = lab.run(f"{robot}-pc", f"systemctl show {SERVICES} --property=NRestarts,ActiveState")
        assert shown.split() == ["NRestarts=0", "ActiveState=active"] * 3


def lines(lab, robot):
    return lab.run(f"{robot}-pc", "journalctl --boot --output cat --unit 'multimaster-*'").splitlines()


def test_wifi_that_comes_after_minutes(lab, slack):
    wait_until(lambda: all("Started" in " ".join(lines(lab, robot)) for robot in STATIC), 30, "the services are there")
    time.sleep(10)
    before = {robot: len(lines(lab, robot)) for robot in STATIC}
    time.sleep(ALONE_SECONDS)
    assert {robot: len(lines(lab, robot)) for robot in STATIC} == before, "nothing new is logged while nothing changes"
    since = time.monotonic()
    for robot in STATIC:
        plug(lab, robot)
    for robot in STATIC:
        expect_seen(lab, robot, [other for other in STATIC if other != robot], slack, since)
    expect_no_restart(lab)


def test_an_address_that_goes_to_another_interface_is_followed(lab):
    """From the cable to the wifi: nobody loses the robot, and nothing is started again."""
    watch = Watch(lab, "ana-pc")
    wait_until(lambda: "publisher /bob/talk /bob_alone" in watch.registrations(), 20, "ana's roscore has bob's topic")
    since = time.monotonic()
    lab.run(
        "bob-pc",
        "ip link add wifi0 type veth peer name port1 && ip link set port1 master lab0 up && ip link set wifi0 up && "
        f"ip address flush dev eth0 && ip link set eth0 down && ip address add {ROBOTS['bob']}/24 dev wifi0",
    )
    time.sleep(3 * OFFLINE_AFTER)
    assert watch.removals(since) == []
    expect_no_restart(lab)


def test_the_nodes_of_a_robot_go_on_where_its_address_is_lost(lab, slack):
    chat(lab, "bob", "bob")
    wait_until(lambda: all(message_times(lab, "bob").values()), 60, "bob hears itself, by rospy and by roscpp")
    watch = Watch(lab, "ana-pc")
    wait_until(lambda: "publisher /bob/talk /bob_alone" in watch.registrations(), 20, "ana's roscore has bob's topic")
    began = time.monotonic()
    lab.run("bob-pc", "ip address flush dev wifi0")
    time.sleep(LOST_SECONDS)
    ended = time.monotonic()
    for library, times in message_times(lab, "bob", began).items():
        gaps = [later - earlier for earlier, later in zip([began, *times], [*times, ended])]
        print(f"\n{library}: {len(times)} messages, the longest pause is {max(gaps):.2f} s")
        assert max(gaps) <= 1.0 + slack(began), library
    gone = watch.removals(began)
    assert gone and gone[0][0] - began <= OFFLINE_AFTER + slack(began)
    back = time.monotonic()
    lab.run("bob-pc", f"ip address add {ROBOTS['bob']}/24 dev wifi0")
    again = "+ publisher /bob/talk /bob_alone"
    wait_until(lambda: again in [text for _at, text in watch.events(back)], 10, "ana's roscore has bob's topic again")
    seconds = next(at for at, text in watch.events(back) if text == again) - back
    print(f"registered again after {seconds:.2f} s")
    assert seconds <= 3.0 + slack(back)
    expect_no_restart(lab)
