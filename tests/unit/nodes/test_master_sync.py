# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The wiring of master_sync, without rospy and without its loop."""

import importlib
import sys
import types
from time import monotonic

import pytest
import rosfleet_multimaster.edge
from rosfleet_multimaster.edge.local_roscore import Start
from rosfleet_multimaster.edge.loop import EndFlag, Loop
from rosfleet_multimaster.protocol import parameters
from rosfleet_multimaster.protocol.messages import Master

URI = "http://robot2:11311/"


@pytest.fixture(name="program")
def _program(monkeypatch):
    ros = types.ModuleType("rosfleet_multimaster.edge.ros")
    monkeypatch.setitem(sys.modules, "rosfleet_multimaster.edge.ros", ros)
    monkeypatch.setattr(rosfleet_multimaster.edge, "ros", ros, raising=False)
    monkeypatch.delitem(sys.modules, "rosfleet_multimaster.master_sync", raising=False)
    module = importlib.import_module("rosfleet_multimaster.master_sync")
    values, _warnings = parameters.overlay(parameters.SYNC, {})
    ros.md5sum = lambda name: None
    ros.ListMasters = lambda: lambda service: None
    ros.Diagnostics = lambda: types.SimpleNamespace(has_listeners=lambda: False, publish=lambda *entries: None)
    ros.SyncNode = lambda held: types.SimpleNamespace(service_uri=lambda: ("", ""))
    roscore = types.SimpleNamespace(ask=lambda *calls: [None] * len(calls))
    start = Start(Loop(), EndFlag(), roscore, "http://own:11311/", "/master_sync", "http://own:1/", values)
    return module.MasterSync(start)


def announced(online):
    return Master("robot2", URI, "http://robot2:11611/", "/master_discovery", 1.0, 1.0, online)


@pytest.mark.parametrize("ending", [False, True])
def test_each_news_of_a_master_is_looked_at_for_a_loss(program, ending):
    seen = []
    program.disconnector._active = True
    program.disconnector._losses.update = lambda online, now: seen.append(online.get(URI)) or ([], [])
    if ending:
        program.ended.set()
    for online in (True, False, True):  # between two passes of the loop
        program._on_announcement("changed", announced(online))
    program._on_list([announced(False)], False, monotonic())
    assert seen == [True, False, True, False]


def test_a_list_asked_for_before_the_news_does_not_undo_it(program):
    asked = monotonic()
    program._on_announcement("changed", announced(True))
    program._on_list([announced(False)], False, asked)
    assert program._online() == {URI: True}
    program._on_list([announced(False)], False, monotonic())
    assert program._online() == {URI: False}


@pytest.mark.parametrize(
    ("listed", "round_due"), [([True], False), ([False], True), ([], False)], ids=["comes", "goes", "missing"]
)
def test_a_list_asks_for_a_round_for_a_lost_master_alone(program, listed, round_due):
    program._on_list([announced(True)] if listed != [True] else [], False, monotonic())
    program.rounds._due = None
    program._on_list([announced(online) for online in listed], False, monotonic())
    assert (program.rounds._due is not None) is round_due
