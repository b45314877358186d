# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The registrations of a relay, with a clock of the test."""

import threading
from types import SimpleNamespace

import pytest
from rosfleet_multimaster.edge.loop import Workers
from rosfleet_multimaster.relay import node
from rosfleet_multimaster.relay.node import PUBLISHER, Registrar

TAKES = 0.3  # seconds of the roscore for all calls at once


class FakeRoscore:
    """A roscore that takes its time; the test says when it is over."""

    def __init__(self):
        self.asked = []

    def ask(self, *calls):
        self.asked.append(calls)
        return [object()] * len(calls)


class Worker:
    """Runs a job when the test says so."""

    def __init__(self):
        self.jobs = []

    def submit(self, job, done):
        self.jobs.append((job, done))

    def run(self):
        job, done = self.jobs.pop()
        done(job(), None)


@pytest.fixture(name="clock")
def _clock(monkeypatch):
    clock = [100.0]
    monkeypatch.setattr(node, "monotonic", lambda: clock[0])
    return clock


def test_the_roscore_has_half_of_its_time_for_others(clock):
    roscore, worker = FakeRoscore(), Worker()
    registrar = Registrar(roscore, "http://10.0.0.1:11911/", worker)
    number, busy = 0, 0.0
    while clock[0] < 110.0:
        number += 1
        registrar.want({(PUBLISHER, f"/topic{number}"): "x/Y"})
        registrar.tick(clock[0])
        if worker.jobs:
            clock[0] += TAKES
            busy += TAKES
            worker.run()
        clock[0] += 0.01
    assert 0.4 * 10.0 < busy <= 0.5 * 10.0 + TAKES


def test_one_change_is_registered_at_once(clock):
    roscore, worker = FakeRoscore(), Worker()
    registrar = Registrar(roscore, "http://10.0.0.1:11911/", worker)
    registrar.want({(PUBLISHER, "/scan"): "x/Y"})
    assert registrar.tick(clock[0]) is None and worker.jobs
    clock[0] += TAKES
    worker.run()
    assert registrar.tick(clock[0]) is None  # nothing is due
    registrar.want({})
    assert registrar.tick(clock[0]) == pytest.approx(clock[0] + TAKES)
    clock[0] += TAKES
    registrar.tick(clock[0])
    worker.run()
    assert [calls[0][0] for calls in roscore.asked] == ["registerPublisher", "unregisterPublisher"]


def test_a_name_that_is_being_registered_is_taken_back_at_the_end():
    """The roscore would have a node that has ended, and nobody would take it away."""
    goes_on, calls = threading.Event(), []

    def ask(*asked):
        if not calls:
            goes_on.wait(10)
        calls.extend(asked)
        return [0] * len(asked)

    loop = SimpleNamespace(post=lambda *_done: None)  # it has ended: no answer comes to the registrar
    registrar = Registrar(SimpleNamespace(ask=ask), "http://10.0.0.1:11911/", Workers(loop, 1))
    registrar.want({(PUBLISHER, "/scan"): "x/Y"})
    registrar.tick(node.monotonic())
    threading.Timer(0.2, goes_on.set).start()
    registrar.withdraw()
    assert [call[:2] for call in calls] == [("registerPublisher", "/scan"), ("unregisterPublisher", "/scan")]
