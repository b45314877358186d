# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Rates, with a clock of the test. Times are seconds."""

import random
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rosfleet_multimaster.relay.core.budget import Budget
from rosfleet_multimaster.relay.core.frames import MD5SUM
from rosfleet_multimaster.relay.core.rates import (
    MOST_FRAMES,
    MOST_HELD,
    Rate,
    RateLimit,
    TreeThrottle,
    find_unknown,
    make_throttle,
)

from tests.unit.nodes.relay.ends import message, tree

TREE = {"type": "tf2_msgs/TFMessage", "md5sum": MD5SUM}


def run(throttle, arrivals, until):
    """Take (time, message), and look in between as often as a loop does; return (time, message) of what leaves."""
    left, arrivals, now = [], sorted(arrivals, reverse=True), 100.0
    while now < until:
        due = throttle.due
        came = arrivals[-1][0] if arrivals else until
        if due is not None and due <= came:
            now = max(now, due)
            left.append((now, throttle.release(now)))
        elif arrivals:
            now, one = arrivals.pop()
            left.append((now, throttle.take(one, now)))
        else:
            break
    return [(at, one) for at, one in left if one is not None]


@given(st.floats(1.0, 50.0), st.lists(st.floats(0.0, 0.3), min_size=20, max_size=100))
def test_a_rate_is_never_exceeded_for_long(rate, pauses):
    now, arrivals = 100.0, []
    for pause in pauses:
        now += pause
        arrivals.append((now, b"x"))
    times = [at for at, _one in run(RateLimit(rate), arrivals, now + 10)]
    for number, early in enumerate(times):
        for more, late in enumerate(times[number:], 1):
            assert more <= (late - early) * rate + 2 + 1e-6


@pytest.mark.parametrize(("hertz", "rate"), [(10, 5), (10, 3), (50, 5), (100, 30), (5.2, 5)])
@pytest.mark.parametrize("jitter", [0.0, 0.3])
def test_the_mean_is_exact_and_what_leaves_is_new(hertz, rate, jitter):
    drawn, seconds = random.Random(1), 60
    at = [100 + (number + jitter * drawn.random()) / hertz for number in range(int(hertz * seconds))]
    left = run(RateLimit(rate), [(time, str(time).encode()) for time in at], 100 + seconds)
    assert len(left) == pytest.approx(rate * seconds, rel=0.03)
    ages = sorted(time - float(one) for time, one in left)
    assert ages[len(left) * 9 // 10] == 0.0, "it leaves as it comes"
    assert ages[-1] <= 2 / rate


@pytest.mark.parametrize("count", [2, 3, 7])
def test_the_last_message_of_a_burst_follows(count):
    arrivals = [(100 + number * 0.01, b"%d" % number) for number in range(count)]
    (first, one), (last, other) = run(RateLimit(1.0), arrivals, 110)
    assert (first, one, other) == (100, b"0", b"%d" % (count - 1)) and last == pytest.approx(101.0, abs=0.03)


def test_a_slower_topic_passes_as_a_whole():
    arrivals = [(100 + number / 4.9, b"%d" % number) for number in range(100)]
    assert run(RateLimit(5.0), arrivals, 200) == arrivals


@pytest.mark.parametrize("together", [False, True])
def test_each_frame_of_a_node_has_the_rate(together):
    """Three joints in turns at 50 Hz each, or one of them beside two others."""
    names = [b"arm", b"hand", b"camera"]
    arrivals = []
    for number in range(500):
        these = [(b"base", name) for name in names]
        steps = [these] if together else [[one] for one in these]
        arrivals += [(100 + number / 50 + part / 150, message(tree(*step))) for part, step in enumerate(steps)]
    left = run(TreeThrottle(5.0), arrivals, 110)
    counts = {name: sum(name in one for _at, one in left) for name in names}
    assert all(count == pytest.approx(50, abs=2) for count in counts.values()), counts
    for _at, one in left:
        (size, number), rest = struct.unpack_from("<2I", one), one[8:]
        assert size == len(one) - 4 and number * (12 + 56 + 8 + 4) <= len(rest) <= number * (12 + 56 + 8 + 10)


def test_the_transforms_of_a_frame_are_the_newest():
    throttle = TreeThrottle(1.0)
    assert throttle.take(message(tree((b"base", b"arm"))), 100.0)
    assert throttle.take(message(tree((b"old", b"arm"))), 100.1) is None
    assert throttle.take(message(tree((b"new", b"arm"))), 100.2) is None
    assert throttle.release(throttle.due) == message(tree((b"new", b"arm"))) and throttle.dropped == 1


@given(st.binary(max_size=300))
def test_any_bytes_are_left_out_or_pass(body):
    throttle = TreeThrottle(5.0)
    one = throttle.take(message(body), 100.0)
    assert one is None or len(one) <= len(body) + 4


def test_frames_without_end_are_bounded():
    throttle = TreeThrottle(1.0)
    for number in range(3):
        for name in range(2 * MOST_FRAMES):
            throttle.take(message(tree((b"base", b"%d" % name + b"x" * 2000))), 100.0 + number / 10)
    assert len(throttle._frames) == MOST_FRAMES and throttle.dropped > 4 * MOST_FRAMES
    assert sum(one.size for one in throttle._frames.values()) == throttle._held <= MOST_HELD


@pytest.mark.parametrize(
    ("topic", "header"),
    [
        ("/move_base/goal", {"type": "move_base_msgs/MoveBaseActionGoal"}),
        ("/move_base/result", {"type": "move_base_msgs/MoveBaseActionResult"}),
        ("/move_base/cancel", {"type": "actionlib_msgs/GoalID"}),
        ("/tf_static", TREE),
        ("/map", {"type": "nav_msgs/OccupancyGrid", "latching": "1"}),
        ("/markers", {"type": "visualization_msgs/Marker"}),
    ],
)
def test_messages_that_count_each_have_no_rate(topic, header):
    throttle = make_throttle(Rate(1.0), topic, header)
    assert [throttle.take(b"%d" % number, 100.0) for number in range(5)] == [b"%d" % number for number in range(5)]


@pytest.mark.parametrize("kind", ["actionlib_msgs/GoalStatusArray", "move_base_msgs/MoveBaseActionFeedback"])
def test_status_and_feedback_have_the_rate(kind):
    throttle = make_throttle(Rate(1.0), "/move_base/status", {"type": kind})
    assert [throttle.take(b"%d" % number, 100.0) for number in range(3)] == [b"0", None, None]


def counts_each(rate, header, topic="/x"):
    throttle = make_throttle(rate, topic, header)
    return [throttle.take(b"%d" % number, 100.0) for number in range(3)] == [b"0", b"1", b"2"]


@pytest.mark.parametrize(
    ("kind", "whole", "each", "unknown"),
    [
        ("my_maps/CostmapUpdate", (), True, True),
        ("my_maps/CostmapUpdate", ("other/*", "my_maps/Costmap"), True, True),
        ("my_maps/CostmapUpdate", ("my_maps/CostmapUpdate",), False, False),
        ("my_maps/CostmapUpdate", ("my_maps/*",), False, False),
        ("map_msgs/OccupancyGridUpdate", (), True, False),
        ("map_msgs/OccupancyGridUpdate", ("map_msgs/*",), False, False),
        ("diagnostic_msgs/DiagnosticArray", (), True, False),
        ("sensor_msgs/LaserScan", (), False, False),
        ("nav_msgs/Odometry", (), False, False),
        ("my_msgs/DockActionFeedback", (), False, False),
        ("", (), True, False),
    ],
)
def test_messages_of_a_type_that_nobody_knows_count_each_and_it_is_told(kind, whole, each, unknown):
    rate, header = Rate(1.0, whole), {"type": kind}
    assert counts_each(rate, header) is each
    assert find_unknown(rate, "/x", header) == (kind if unknown else "")
    assert not find_unknown(rate, "/x", {**header, "latching": "1"}) and not find_unknown(Rate(), "/x", header)


class Payer:
    """A connection whose messages wait for their rate."""

    robot, progress, is_sending, is_stuck = "robot2", 0.0, False, False

    def __init__(self, budget, header):
        self.throttle = make_throttle(Rate(0.1), "/x", header, budget)
        budget.payers.add(self)

    @property
    def size(self):
        return self.throttle.size

    def shrink(self):
        self.throttle.drop_all()


@pytest.mark.parametrize("header", [{"type": "sensor_msgs/Image"}, TREE], ids=["messages", "transforms"])
def test_what_waits_for_its_rate_is_in_the_budget(header):
    budget, limit = Budget(100_000), 100_000
    payers = [Payer(budget, header) for _number in range(40)]
    for turn in range(50):
        for number, payer in enumerate(payers):
            names = [(b"base", b"%d %d" % (number, frame)) for frame in range(40)]
            payer.throttle.take(message(tree(*names)) if header is TREE else message(bytes(5000)), 100.0 + turn / 100)
            assert budget.used <= limit
    assert sum(payer.throttle.dropped for payer in payers) > 100 and budget.used > limit / 2
    for payer in payers:
        payer.throttle.release(1000.0)
        payer.throttle.close()
    assert budget.used == 0
