# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Parameters that cross between two roscores, with real XML-RPC: kept up to date, refused, taken away, after a kill too."""

import os
import pathlib
import random
import signal
import subprocess
import sys
import threading
from functools import partial

import copies_program as program
import pytest
from parameter_server import ParameterServer
from rosfleet_multimaster.edge.clock import monotonic
from rosfleet_multimaster.edge.loop import Loop
from rosfleet_multimaster.sync import copies as module
from running_sync import until

HERE = pathlib.Path(__file__).parent
PYTHON = HERE.parents[3] / "roles/nodes/files/python"


class Running:
    """Two roscores, and a Copies that copies from one to the other."""

    def __init__(self, names):
        self.own, self.other, self.names = ParameterServer(), ParameterServer(), names
        self.loop = self.copies = self.core = None
        self.changes = []
        self.namespace = ""

    def start(self, names=None):
        """Begin a life; the robot is there."""
        self.loop = Loop()
        names = self.names if names is None else names
        self.copies, self.core = program.make(
            self.own.uri, self.other.uri, names, self.loop, lambda: self.changes.append(1), self.namespace
        )
        self.copies.take_over()
        self.core.take_announcement(program.announced(self.other.uri), monotonic())
        thread = threading.Thread(target=self.loop.run, args=(self._tick,), daemon=True)
        thread.start()
        return self

    def _tick(self, now):
        return min(self.copies.tick(now) or now + 1.0, now + 1.0)

    def announce(self, **changes):
        self.loop.post(self.core.take_announcement, program.announced(self.other.uri, **changes), monotonic())
        self.loop.post(self.copies.look_soon)

    def end(self):
        """The end of a service."""
        over = threading.Event()
        self.loop.post(self.copies.withdraw, over.set)
        assert over.wait(10)
        self.loop.stop()

    def refused(self):
        return {item.name: item.holder for item in self.copies.refused}


@pytest.fixture(autouse=True)
def quick(monkeypatch):
    for name, seconds in (
        ("ASK", 0.05),
        ("LOOK", 0.05),
        ("ROUND", 0.2),
        ("AGAIN", 0.05),
        ("LEFTOVERS", 0.5),
        ("SELDOM", 0.5),
    ):
        monkeypatch.setattr(module, name, seconds)
    monkeypatch.setattr(module, "RETRY", (0.05,))


@pytest.fixture(name="made")
def _made():
    found = []

    def make(*names, **tree):
        running = Running(names)
        running.other.tree.update(tree)
        found.append(running)
        return running

    yield make
    for running in found:
        if running.loop is not None:
            running.loop.stop()
        running.own.server.stop()
        running.other.server.stop()


def test_a_parameter_is_in_the_namespace_of_its_robot(made):
    lab = made("/robot_description", robot_description="<robot/>")
    lab.namespace = "/kobuki1"
    lab.own.set("/x", "/robot_description", "<own/>")
    lab.start()
    until(lambda: lab.own.own() == {"robot_description": "<own/>", "kobuki1": {"robot_description": "<robot/>"}})
    lab.other.set("/x", "/robot_description", "<robot name='2'/>")
    until(lambda: lab.own.tree["kobuki1"] == {"robot_description": "<robot name='2'/>"})
    lab.end()
    assert lab.own.own() == {"robot_description": "<own/>", "kobuki1": {}}


def test_a_parameter_follows_the_one_of_the_other_robot(made):
    lab = made(
        "/robot_description", "/tibi", robot_description="<robot/>", tibi={"speed": 1.5, "names": ["a"]}, other=1
    )
    lab.start()
    until(lambda: lab.own.own() == {"robot_description": "<robot/>", "tibi": {"speed": 1.5, "names": ["a"]}})
    lab.other.set("/x", "/robot_description", "<robot name='2'/>")
    until(lambda: lab.own.tree["robot_description"] == "<robot name='2'/>")
    lab.other.delete("/x", "/tibi")
    until(lambda: "tibi" not in lab.own.tree)
    lab.other.set("/x", "/tibi", {"speed": 2})
    until(lambda: lab.own.tree.get("tibi") == {"speed": 2})
    lab.end()
    assert lab.own.tree == {"rosfleet_multimaster": {}} and not lab.other.changes[3:], "the other one is only read"


def test_an_own_value_is_a_conflict_and_stays(made):
    lab = made("/a", "/b/c", "/d", a=1, b={"c": 1}, d=1)
    lab.own.tree.update(a="own", b="own", d={"e": "own"})
    lab.start()
    until(lambda: len(lab.refused()) == 3)
    assert all("here it has a value of its own" in why for why in lab.refused().values())
    lab.other.set("/x", "/a", 2)
    lab.own.delete("/x", "/d")
    until(lambda: lab.own.tree.get("d") == 1 and len(lab.refused()) == 2)
    lab.end()
    assert lab.own.own() == {"a": "own", "b": "own"}


def test_who_changes_a_copy_keeps_it(made):
    lab = made("/a", a=1).start()
    until(lambda: lab.own.own() == {"a": 1})
    lab.own.set("/x", "/a", "own")
    until(lambda: "/a" in lab.refused())
    lab.other.set("/x", "/a", 2)
    lab.end()
    assert lab.own.own() == {"a": "own"}


def test_a_lost_robot_takes_its_parameters_along(made):
    lab = made("/a", a=1).start()
    until(lambda: lab.own.own() == {"a": 1})
    lab.announce(online=False)
    until(lambda: lab.own.own() == {})
    lab.announce()
    until(lambda: lab.own.own() == {"a": 1})
    lab.loop.post(lab.core.remove, lab.other.uri)
    until(lambda: lab.own.own() == {})


def test_a_roscore_that_does_not_answer_loses_nothing(made):
    lab = made("/a", a=1).start()
    until(lambda: lab.own.own() == {"a": 1})
    lab.other.wrong["/a"] = "nonsense"
    until(lambda: lab.copies._sources["robot2"].failures > 2)
    assert lab.own.own() == {"a": 1}
    lab.other.wrong.clear()
    lab.other.set("/x", "/a", 2)
    until(lambda: lab.own.own() == {"a": 2})


def test_a_stranger_gives_nothing(made):
    lab = made("/a", a=1)
    lab.start()
    until(lambda: lab.own.own() == {"a": 1})
    stranger = ParameterServer()
    stranger.tree["a"] = 666
    lab.loop.post(lab.core.take_announcement, program.announced(stranger.uri), monotonic())
    asked = lab.own.asked
    until(lambda: lab.own.asked > asked + 3)
    assert lab.own.own() == {"a": 1} and not stranger.asked
    stranger.server.stop()


def test_nothing_changes_where_nothing_changed(made):
    lab = made("/a", a={"b": [1, 2.5, "c"], "d": True}).start()
    until(lambda: "a" in lab.own.tree)
    asked, changes = lab.other.asked, list(lab.own.changes)
    until(lambda: lab.other.asked > asked + 5)
    assert lab.own.changes == changes


def test_what_is_large_is_asked_for_less_often(made, monkeypatch):
    monkeypatch.setattr(module, "RATE", 1 << 10)
    monkeypatch.setattr(module, "SELDOM", 60.0)
    lab = made("/a", a="x" * (1 << 19)).start()
    until(lambda: "a" in lab.own.tree)
    source = lab.copies._sources["robot2"]
    until(lambda: not source.asking)
    assert source.due - monotonic() > module.SELDOM - 5


def test_too_much_of_one_name_leaves_the_others_alone(made):
    lab = made("/a", "/b", "/c", a=1, b="x" * (3 << 20), c=["y" * (1 << 20)]).start()
    until(lambda: lab.own.own() == {"a": 1} and len(lab.refused()) == 2)
    assert "2097152 bytes" in lab.refused()["/b"] and "1048576 bytes" in lab.refused()["/c"]


HOSTILE = [
    [1, "", float("inf")],
    [1, "", 1 << 40],
    [1, "", {"a/b": 1}],
    [1, "", {"": 1}],
    [1, ""],
    [0, "", 1],
    ["1", "", 1],
    {"faultCode": 1, "faultString": "\x1b[31mno"},
    "nonsense",
    [1, "", ["x" * 1000] * 2000],
    [1, "", {f"k{number}": number for number in range(30_000)}],
    [1, "", None],
    [2**31 - 1, "", "ok"],
]


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(6))
def test_hostile_answers_do_no_harm(made, seed):
    numbers = random.Random(seed)
    lab = made("/a", "/b", a=1, b=2)
    lab.own.tree.update(run_id="own", use_sim_time=False, c="own")
    lab.start()
    for _count in range(4):
        lab.other.wrong[numbers.choice(["/a", "/b"])] = numbers.choice(HOSTILE)
        lab.other.tree.update(run_id="hostile", use_sim_time=True, c="hostile")
        until(partial(lab.other.is_asked_after, lab.other.asked + 1))
    lab.other.wrong.clear()
    lab.other.tree["a"] = "good"
    until(lambda: lab.own.tree.get("a") == "good" and lab.own.tree.get("b") == 2 and not lab.refused())
    lab.end()
    assert lab.own.own() == {"run_id": "own", "use_sim_time": False, "c": "own"}


def killed_at(lab, number, when):
    """Run the program until it is killed at a change of the own roscore, before or after it."""
    words = [sys.executable, str(HERE.parent / "copies_program.py"), lab.own.uri, lab.other.uri, *lab.names]
    paths = os.pathsep.join(map(str, (PYTHON, HERE.parent)))
    child = subprocess.Popen(words, env={**os.environ, "PYTHONPATH": paths}, stderr=subprocess.DEVNULL)
    count = [0]

    def look():
        count[0] += 1
        if count[0] == number:
            child.send_signal(signal.SIGKILL)
            child.wait()

    setattr(lab.own, when, look)
    try:
        return child.wait(15) == -signal.SIGKILL
    finally:
        child.kill()
        lab.own.before = lab.own.after = lambda: None


@pytest.mark.slow
@pytest.mark.parametrize("number", [1, 2, 3])
@pytest.mark.parametrize("when", ["before", "after"])
def test_after_a_kill_the_next_life_knows_its_own(made, number, when):
    lab = made("/a", "/b", a=1, b={"c": 2})
    lab.own.tree["d"] = "own"
    assert killed_at(lab, number, when)
    lab.other.tree["a"] = 3
    lab.start()
    until(lambda: lab.own.own() == {"a": 3, "b": {"c": 2}, "d": "own"})
    assert not lab.refused()
    lab.end()
    assert lab.own.own() == {"d": "own"}


def test_after_a_kill_another_plan_leaves_nothing(made):
    lab = made("/a", "/b", a=1, b=2)
    assert killed_at(lab, 3, "after")
    assert lab.own.own() == {"a": 1, "b": 2}
    lab.own.set("/x", "/b", "own")
    lab.start(names=())
    until(lambda: lab.own.own() == {"b": "own"})


def test_after_a_kill_a_robot_has_time_to_come_back(made, monkeypatch):
    monkeypatch.setattr(module, "LEFTOVERS", 30)  # it comes back long before, on a busy machine too
    lab = made("/a", a=1)
    assert killed_at(lab, 2, "after")
    lab.own.changes.clear()
    lab.start()
    until(lambda: lab.copies._sources["robot2"].met)
    assert lab.own.own() == {"a": 1} and not [change for change in lab.own.changes if change[1] == "/a"]
