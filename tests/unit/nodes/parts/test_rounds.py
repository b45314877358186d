# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Rounds without a roscore: what is kept of an earlier life, and how long."""

import types

import pytest
from rosfleet_multimaster.core.filters import Filters
from rosfleet_multimaster.core.message_types import TypeGuard
from rosfleet_multimaster.core.sync import Sync, View
from rosfleet_multimaster.edge.loop import Loop, Workers
from rosfleet_multimaster.parts import imports, program
from rosfleet_multimaster.parts import rounds as module

OTHER, TALKER = "http://robot2:11311/", ("/talker", "http://robot2:40000/")


@pytest.mark.parametrize(("after", "kept"), [(module.LEFTOVERS - 1, True), (module.LEFTOVERS + 1, False)])
def test_leftovers_wait_from_the_end_of_the_wiring(monkeypatch, after, kept):
    now, record = [100.0], imports.write("/master_sync", "http://own:1/", {TALKER: OTHER})
    monkeypatch.setattr(module, "monotonic", lambda: now[0])
    loop, limited, guard = Loop(), program.Limited(), TypeGuard()
    roscore = types.SimpleNamespace(ask=lambda *calls: [record if calls[0][0] == "getParam" else 0])
    core = Sync(Filters(), "http://own:11311/", "/master_sync", False, False, None)
    workers = Workers(loop, 1)
    made = module.Rounds(roscore, None, ("/master_sync", "http://own:1/"), core, guard, workers, workers, limited)
    made.take_over()
    now[0] += 10.0  # a busy computer: rospy makes the node meanwhile
    lost = types.SimpleNamespace(registered=lambda *seen: None)
    made.connect(None, lost, lambda: True, lambda refused: None, lambda problem: None)
    view = View({"/chatter": ("/talker",)}, {}, {}, {"/chatter": "std_msgs/String"}, dict([TALKER]), {})
    todo = made._plan(module.Reading([], view, dict(made.claims)), now[0] + after)
    assert bool(todo.held) is kept
