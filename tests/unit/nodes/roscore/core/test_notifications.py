# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The order in which nodes are notified."""

import pytest
from rosfleet_multimaster.roscore.core import notifications
from rosfleet_multimaster.roscore.core.notifications import (
    LONGEST,
    PATIENCE,
    PAUSE,
    PER_HOST,
    QUICK,
    SLOW,
    WORKERS,
    Notifications,
)


def told(plan, uri="http://a:1/", host="a", topic="/chatter", value=1):
    plan.add(uri, host, "publisherUpdate", topic, (topic, value))


def all_of(plan, now, answered=True):
    """All calls that are due now, each answered at once."""
    found = []
    while True:
        call, _due = plan.next(now)
        if call is None:
            return found
        plan.finish(call, now, answered)
        found.append(call)


def test_a_first_change_is_told_at_once_and_only_once():
    plan = Notifications()
    told(plan)
    assert [call.arguments for call in all_of(plan, 0.0)] == [("/chatter", 1)]
    assert plan.next(100.0) == (None, None)


def test_waiting_changes_keep_the_newest_in_order():
    plan = Notifications()
    for topic, value in (("/a", 1), ("/b", 1), ("/a", 2)):
        told(plan, topic=topic, value=value)
    assert [call.arguments for call in all_of(plan, 0.0)] == [("/b", 1), ("/a", 2)]


def test_a_burst_of_ten_thousand_changes_is_a_few_calls():
    plan, calls, now = Notifications(), [], 0.0
    for value in range(10000):  # two seconds
        now += 0.0002
        told(plan, value=value)
        calls += all_of(plan, now)
    calls += all_of(plan, now + LONGEST)
    assert len(calls) <= 7 and calls[0].arguments == ("/chatter", 0) and calls[-1].arguments == ("/chatter", 9999)


@pytest.mark.parametrize("takes", [0.001, 0.05, 0.2])
def test_a_burst_is_a_few_calls_for_a_slow_subscriber_too(takes):
    """A subscriber that is slow to answer is told less often, and not more often."""
    plan, calls, ends, now, waits = Notifications(), [], 0.0, 0.0, 0.0
    current, oldest = None, 0.0
    for value in range(10000):
        now += 0.0002
        told(plan, value=value)
        oldest = oldest or now
        if current is not None and now >= ends:
            plan.finish(current, now, True)
            current = None
        if current is None:
            current, _due = plan.next(now)
            if current is not None:
                calls.append(current)
                ends, waits, oldest = now + takes, max(waits, now - oldest), 0.0
    assert len(calls) <= 7 and waits <= LONGEST + takes + 0.001


def test_a_few_changes_at_once_are_no_burst():
    """As many as start with a launch file: a later one waits for no more than it did."""
    plan = Notifications()
    for value in range(4):
        told(plan, value=value)
        assert len(all_of(plan, value * 0.04)) == 1, "each is told at once"


def test_ten_thousand_topics_in_a_burst_are_each_told_once():
    plan = Notifications()
    for value in range(3):
        for number in range(10000):
            told(plan, topic=f"/topic_{number}", value=value)
    calls = all_of(plan, 0.0)
    assert len(calls) == 10000 and {call.arguments[1] for call in calls} == {2}


def test_after_a_quiet_time_a_change_is_told_at_once_again():
    plan, now = Notifications(), 0.0
    for _round in range(5):
        told(plan)
        assert len(all_of(plan, now)) == 1
        now += 2.0


def test_the_second_change_waits_a_moment_only():
    plan = Notifications()
    told(plan)
    all_of(plan, 0.0)
    told(plan, value=2)
    call, due = plan.next(0.001)
    assert call is None and due == PAUSE
    assert len(all_of(plan, PAUSE)) == 1


def test_a_node_has_one_call_at_a_time():
    plan = Notifications()
    told(plan)
    call, _due = plan.next(0.0)
    told(plan, topic="/other")
    assert plan.next(0.0)[0] is None
    plan.finish(call, 0.0, True)
    assert plan.next(0.0)[0].key == ("publisherUpdate", "/other")


def begun(plan, now):
    """All calls that begin now; none ends."""
    found = []
    while (call := plan.next(now)[0]) is not None:
        found.append(call)
    return found


def test_a_lost_robot_has_few_workers_and_own_nodes_do_not_wait():
    plan = Notifications()
    for port in range(50):
        told(plan, f"http://lost:{port}/", "lost")
    told(plan, "http://own:1/", "own")
    first = begun(plan, 0.0)
    assert len(first) == QUICK + 1 and first[-1].uri == "http://own:1/"
    later = [call for tenth in range(1, 40) for call in begun(plan, tenth / 10)]
    assert len(first + later) == PER_HOST + 1 < WORKERS / 2
    for call in [*first, *later]:
        plan.finish(call, 4.0, call.uri == "http://own:1/")
    now = 4.0
    while calls := [call for call in begun(plan, now) if call]:
        now += 0.1
        for call in calls:
            plan.finish(call, now, False)
        if now > 6.5:
            break
    assert len(begun(plan, 100.0)) <= SLOW, "those that were silent have few workers together"


def test_silent_own_nodes_delay_the_others_only_for_a_moment():
    plan = Notifications()
    for port in range(20):
        told(plan, f"http://own:{port}/", "own")
    told(plan, "http://own:99/", "own")
    times = {call.uri: tenth / 10 for tenth in range(10) for call in begun(plan, tenth / 10)}
    assert times["http://own:99/"] <= 0.3
    assert plan.next(1.0) == (None, None)


def test_who_waits_for_room_is_told_when_there_is_some():
    plan = Notifications()
    for port in range(20):
        told(plan, f"http://own:{port}/", "own")
    assert len(begun(plan, 5.0)) == QUICK
    call, due = plan.next(5.01)
    assert call is None and due == pytest.approx(5.1)
    assert len(begun(plan, due + 0.001)) == QUICK


def test_a_silent_node_is_asked_with_the_newest_and_given_up():
    plan = Notifications()
    told(plan, value=1)
    call, _due = plan.next(0.0)
    told(plan, value=2)
    plan.finish(call, 3.0, False)
    assert plan.next(3.0) == (None, 3.0 + notifications.RETRY)
    call, _due = plan.next(4.0)
    assert call.arguments == ("/chatter", 2)
    now = 7.0
    plan.finish(call, now, False)
    while (due := plan.next(now)[1]) is not None:
        call, _due = plan.next(due)
        now = due + 3.0
        plan.finish(call, now, False)
    assert PATIENCE < now < 2 * PATIENCE and plan.next(now + 2 * PATIENCE) == (None, None)


def test_a_node_that_answers_again_has_all_that_waits():
    plan = Notifications()
    told(plan)
    call, _due = plan.next(0.0)
    plan.finish(call, 3.0, False)
    told(plan, topic="/other")
    assert [found.key[1] for found in all_of(plan, 5.0)] == ["/chatter", "/other"]


def test_nobody_listens_there_any_more():
    plan = Notifications()
    told(plan)
    call, _due = plan.next(0.0)
    told(plan, topic="/other")
    plan.finish(call, 0.0, False, gone=True)
    assert plan.next(100.0) == (None, None) and not plan.waits()


def test_nothing_stays_of_nodes_that_were_told_all():
    plan = Notifications()
    for port in range(100):
        told(plan, f"http://a:{port}/")
    all_of(plan, 0.0)
    plan.tidy(10.0)
    assert not plan._nodes and not plan._busy and not plan._ready
