# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Rounds without a roscore: what is kept of an earlier life, and how long."""

import types

import pytest
from rosfleet_multimaster.edge.loop import Loop, Workers
from rosfleet_multimaster.edge.process import program
from rosfleet_multimaster.protocol import imports
from rosfleet_multimaster.protocol.filters import Filters
from rosfleet_multimaster.protocol.messages import Registration, View
from rosfleet_multimaster.sync import rounds as module
from rosfleet_multimaster.sync.core.message_types import TypeGuard
from rosfleet_multimaster.sync.core.sync import NEVER, Candidate, Sync

CALLBACKS = module.RoundCallbacks(lambda: True, lambda problem: None)
OTHER, TALKER = "http://robot2:11311/", ("/talker", "http://robot2:40000/")


@pytest.mark.parametrize(("after", "kept"), [(module.LEFTOVERS - 1, True), (module.LEFTOVERS + 1, False)])
def test_leftovers_wait_from_the_first_pass_of_the_loop(monkeypatch, after, kept):
    now, record = [100.0], imports.write("/master_sync", "http://own:1/", {TALKER: OTHER})
    monkeypatch.setattr(module, "monotonic", lambda: now[0])
    loop, limited = Loop(), program.LimitedLog()
    roscore = types.SimpleNamespace(ask=lambda *calls: [record if calls[0][0] == "getParam" else 0])
    core = Sync(Filters(), "http://own:11311/", "/master_sync", False, False, NEVER)
    workers = Workers(loop, 1)
    graph, disconnector = (
        types.SimpleNamespace(roscore=roscore),
        types.SimpleNamespace(note_registrations=lambda *news: None),
    )
    questions = types.SimpleNamespace(guard=TypeGuard(), ask=lambda verdict: None)
    node = ("/master_sync", "http://own:1/")
    made = module.Rounds(graph, node, core, questions, disconnector, workers, workers, limited, CALLBACKS)
    made.take_over()
    now[0] += 10.0  # a busy computer: rospy makes the node meanwhile
    made.tick(now[0])
    view = View({"/chatter": ("/talker",)}, {}, {}, {"/chatter": "std_msgs/String"}, dict([TALKER]), {})
    todo = made._plan(set(), set(), view, now[0] + after)
    assert bool(todo.held) is kept


def test_after_a_round_the_next_one_waits_for_more_news(monkeypatch):
    now, began = [100.0], []
    monkeypatch.setattr(module, "monotonic", lambda: now[0])
    made = rounds_of(lambda: began.append(now[0]), lambda seconds: now.__setitem__(0, now[0] + seconds))
    made.soon(now[0])
    made.tick(now[0])
    assert began == [100.0] and now[0] == pytest.approx(100.2) and not made.working
    made.soon(now[0])  # news that came meanwhile
    assert made.tick(now[0]) == pytest.approx(100.2 + min(0.2 * module.REST, module.LONGEST_REST)) and len(began) == 1
    made.tick(100.2 + module.LONGEST_REST + 0.01)
    assert len(began) == 2


def test_registrations_of_an_earlier_life_are_compared(monkeypatch):
    now = [100.0]
    monkeypatch.setattr(module, "monotonic", lambda: now[0])
    made = rounds_of(lambda: None, lambda _seconds: None)
    gone, there = (Registration("publisher", f"/{name}", "/talker", TALKER[1]) for name in ("gone", "there"))
    now[0] += module.LEFTOVERS  # nobody waits for it any more
    made.claims, made.held = {TALKER: OTHER}, {gone: OTHER, there: OTHER}
    made._view = View({"/gone": ("/talker",), "/there": ("/talker",)}, {}, {}, {}, dict([TALKER]), {})
    monkeypatch.setattr(made._core, "find_candidates", lambda items, _now: {there: Candidate(there, OTHER, "robot2")})
    made.touch_all(OTHER, {there})
    made.tick(now[0])
    assert made.held == {there: OTHER} and OTHER in made.met
    assert made.tick(now[0]) == now[0] + module.SETTLED, "a round looks at everything soon"


def test_a_node_that_a_step_withdraws_is_noted_as_no_own_one(monkeypatch):
    """Else it would be asked for its connections when a third robot is lost: it has ended, or may be out of reach."""
    now, notes = [100.0], []
    monkeypatch.setattr(module, "monotonic", lambda: now[0])
    made = rounds_of(lambda: None, lambda _seconds: None)
    monkeypatch.setattr(made._disconnector, "note_registrations", lambda *news: notes.append(news))
    made.tick(now[0])  # the loop begins
    now[0] += module.LEFTOVERS
    gone = Registration("publisher", "/gone", *TALKER)
    made.claims, made.held, made.met = {TALKER: OTHER}, {gone: OTHER}, {OTHER}
    made._view = View({"/gone": ("/talker",)}, {}, {}, {}, dict([TALKER]), {})
    made.touch({gone})
    made.tick(now[0])
    ((held, noted, claims, _now),) = notes
    assert (held, claims, noted.local_nodes(claims)) == ({}, {}, {})
    assert (made.claims, made.held) == ({}, {})


def test_the_round_waits_for_whole_states_within_a_bound(monkeypatch):
    now, began = [100.0], []
    monkeypatch.setattr(module, "monotonic", lambda: now[0])
    made = rounds_of(lambda: began.append(now[0]), lambda _seconds: None)
    made.soon(now[0])
    made.tick(now[0])
    assert began == [100.0] and made.tick(now[0]) == 100.0 + module.ROUND
    first = now[0] = 100.0 + module.ROUND - 1
    while len(began) == 1 and now[0] < first + 60:  # a fleet that meets: a state each second
        made.touch_all(OTHER, set())
        now[0] += 1
        made.tick(now[0])
    assert began[1:] == [first + module.SETTLED_AFTER_ALL]
    assert made.tick(now[0]) == now[0] + module.ROUND


def test_a_state_that_comes_during_a_round_has_the_next_one(monkeypatch):
    now = [100.0]
    monkeypatch.setattr(module, "monotonic", lambda: now[0])
    made = rounds_of(lambda: made.touch_all(OTHER, set()), lambda _seconds: None)
    made.soon(now[0])
    made.tick(now[0])
    assert made.tick(now[0]) == now[0] + module.SETTLED


def rounds_of(begun, last):
    """Rounds with a roscore that holds nothing; each takes 0.2 s."""

    def submit(job, done):
        try:
            found = job(), None
        except OSError as problem:
            found = None, problem
        last(0.1)
        done(*found)

    def read(_look_up):
        begun()
        return View({}, {}, {}, {}, {}, {})

    workers = types.SimpleNamespace(submit=submit)
    roscore = types.SimpleNamespace(ask=lambda *calls: [None for _call in calls])
    graph = types.SimpleNamespace(
        roscore=roscore, guards_names=True, read=read, carry_out=lambda calls: [[1, "", 0] for _call in calls]
    )
    core = Sync(Filters(), "http://own:11311/", "/master_sync", False, False, NEVER)
    node = ("/master_sync", "http://own:1/")
    disconnector, questions = (
        types.SimpleNamespace(note_registrations=lambda *news: None),
        types.SimpleNamespace(guard=TypeGuard(), ask=lambda verdict: None),
    )
    return module.Rounds(graph, node, core, questions, disconnector, workers, workers, program.LimitedLog(), CALLBACKS)
