# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""A watch: what differs from the first values is lost, with its moment; what is as before has returned."""

from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.watch import watch as module
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.watch.watch import Watch

WALL = 1_730_000_000.0


def events(watch):
    return [(event["kind"], event["name"], event["well"], event["after"]) for event in watch.events]


def test_the_first_value_is_the_one_to_keep():
    watch = Watch(0.0, WALL)
    assert not watch.read(WALL, {("route", "default"): "10.0.0.1"})
    assert watch.read(WALL + 3, {("route", "default"): "no route"})
    assert not watch.read(WALL + 6, {("route", "default"): "10.0.0.9"})  # still lost, and told once
    assert watch.report(6.0)["lost"] == [{"kind": "route", "name": "default"}]
    assert not watch.read(WALL + 9, {("route", "default"): "10.0.0.1"})
    assert events(watch) == [("route", "default", False, 3.0), ("route", "default", True, 9.0)]
    assert (watch.events[0]["expected"], watch.events[0]["found"]) == ("10.0.0.1", "no route")
    assert watch.report(9.0)["lost"] == []


def test_a_service_down_at_the_first_look_is_lost_at_once():
    watch = Watch(0.0, WALL)
    assert watch.read(WALL + 1, {("service", "a.service"): "failed", ("port", "pc"): "open"})
    assert watch.report(1.0)["lost"] == [{"kind": "service", "name": "a.service"}]


def test_silence_is_lost_from_the_last_heartbeat_on():
    watch = Watch(0.0, WALL)
    for second in range(10):
        watch.hear(float(second), "group", "pc", 1.0)
    assert not watch.beat(9.0 + module.QUIET, WALL + 9 + module.QUIET)
    assert watch.beat(9.1 + module.QUIET, WALL + 9.1 + module.QUIET)
    watch.hear(20.0, "group", "pc", 1.0)
    watch.beat(20.5, WALL + 20.5)
    assert events(watch) == [("group", "pc", False, 9.0), ("group", "pc", True, 20.5)]


def test_who_promises_few_heartbeats_may_be_silent_for_longer():
    assert module.silence(10.0) == module.QUIET
    assert module.silence(0.5) == 8.0
    assert module.silence(0.0) == module.UNPROMISED


def test_a_promise_that_changes_counts_from_then_on():
    watch = Watch(0.0, WALL)
    watch.hear(0.0, "group", "pc", 1.0)
    watch.hear(1.0, "group", "pc", 0.1)
    assert not watch.beat(30.0, WALL + 30)
    assert watch.beat(42.0, WALL + 42)


def test_events_are_bounded_and_counted():
    watch = Watch(0.0, WALL)
    watch.read(WALL, {("link", "eth0"): "up"})
    for number in range(module.EVENTS + 7):
        watch.read(WALL + number, {("link", "eth0"): "down" if number % 2 == 0 else "up"})
    assert (len(watch.events), watch.report(1.0)["dropped"]) == (module.EVENTS, 7)


def test_a_flood_of_senders_is_bounded():
    watch = Watch(0.0, WALL)
    for number in range(module.SENDERS + 100):
        watch.hear(0.0, "group", f"pc{number}", 1.0)
    assert watch.report(0.0)["watched"] == module.SENDERS
