# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The memory that each robot holds for registrations and parameters: always the sum of what it has made."""

import random
import tracemalloc

import pytest
from rosfleet_multimaster.roscore.core import bounds
from rosfleet_multimaster.roscore.core.bounds import BOUNDS, BoundRefusal, Usage, weigh, weigh_registration
from rosfleet_multimaster.roscore.core.holdings import Holdings
from rosfleet_multimaster.roscore.core.registry import Registry

from tests.unit.nodes.roscore.records import rec

ROBOTS = (None, "robot2", "robot3", "")


class Some:
    """The parameters of a roscore, as the master changes them."""

    def __init__(self):
        self.usage, self.holdings, self.registry = Usage(), Holdings(), Registry()
        self.holdings.set_robots(ROBOTS[1:])

    def set(self, name, value, robot=None):
        tree = self.registry.parameters
        change = self.holdings.plan_set(tree, name, self.usage.growth(tree, name, value), robot)
        self._apply(change, rec("set", name, value)._replace(by=robot))

    def delete(self, name):
        self._apply(self.holdings.plan_delete(self.registry.parameters, name), rec("delete", name))

    def _apply(self, change, record):
        self.usage.parameters += change.total
        self.holdings.apply(change)
        self.registry.apply(record)

    def count(self):
        return [self.holdings.count(robot, "parameters") for robot in ROBOTS]


def draw(rng, depth=0):
    if depth < 3 and rng.random() < 0.6:
        return {f"k{rng.randrange(4)}": draw(rng, depth + 1) for _member in range(rng.randrange(4))}
    return "x" * rng.randrange(100)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(100))
def test_each_robot_has_what_it_has_set(seed):
    """After any changes: the sums are those of a count of the whole tree, and of all robots together that of the tree."""
    rng, some = random.Random(seed), Some()
    for _change in range(60):
        name = "/" + "/".join(f"k{rng.randrange(4)}" for _part in range(rng.randrange(1, 4)))
        if rng.random() < 0.25:
            some.delete(name)
        elif rng.random() < 0.05:
            some.set("/", {"k1": draw(rng)}, rng.choice(ROBOTS))
        else:
            some.set(name, draw(rng), rng.choice(ROBOTS))
        assert some.holdings.owners == some.registry.owners
        anew = Holdings()
        anew.restore([], some.registry.owners)
        anew.recount(some.registry.parameters)
        assert some.count() == [anew.count(robot, "parameters") for robot in ROBOTS]
        assert sum(some.count()) == some.usage.parameters == weigh(some.registry.parameters)


def test_who_replaces_or_deletes_a_parameter_gives_its_room_back():
    some = Some()
    some.set("/robot/speed", "x" * 1000, "robot2")
    some.set("/robot/name", "x" * 100)
    own, other, *_none = some.count()
    assert other > 1000 and own < 1000
    some.set("/robot/speed", "x" * 2000)
    assert some.count()[1] < 1000 < some.count()[0]
    some.delete("/robot")
    assert some.count() == Some().count() and some.holdings.owners.root is None


@pytest.mark.parametrize(("bound", "piece"), [("parameters", 1 << 20), ("registrations", 10_000)])
def test_one_fills_its_share_and_the_others_have_room(bound, piece):
    """Each of the others has its part, when as many as there may be have filled what is for who comes first."""
    some, of_one = Some(), BOUNDS[f"{bound} of one"].most

    def add(robot, number):
        if bound == "parameters":
            some.set(f"/{robot}/p{number}", "x" * piece, robot)
        else:
            texts = (f"/{robot}/{number}" + "x" * piece, "/node", "http://robot:1/")
            some.holdings.check(robot, "/topic", *texts)
            record = rec("publisher", *texts, True)._replace(by=robot)
            some.holdings.note(record, some.usage.count(record))

    for robot in ("robot2", "somebody", "nobody", "another"):
        with pytest.raises(BoundRefusal) as refusal:
            for number in range(20_000):
                add(robot, number)
        assert refusal.value.bound == f"{bound} of one" and some.holdings.count(robot, bound) <= of_one
    assert some.holdings.count("robot2", bound) > of_one - 2 * piece
    add("robot3", 0)
    add("", 0)
    with pytest.raises(BoundRefusal) as refusal:
        for number in range(100_000):
            add(None, number)
    assert refusal.value.bound == bound and some.holdings.count(None, bound) > BOUNDS[bound].most / 2 - 2 * piece


def test_a_registration_that_another_one_replaces_or_ends_is_given_back():
    holdings, usage = Holdings(), Usage()

    def note(record, robot=None):
        record = record._replace(by=robot)
        holdings.note(record, usage.count(record))

    service = ("/serve", "/a", "rosrpc://a:5", "http://a:1/")
    note(rec("service", *service, True), "robot2")
    note(rec("node", "/a", "http://a:1/"), "robot2")
    assert holdings.count("robot2") == weigh_registration(*service) + weigh_registration("/a", "http://a:1/") - 1000
    note(rec("service", "/serve", "/b", "rosrpc://b:5", "http://b:1/", True), "robot3")
    assert holdings.count("robot2") < 1000 < holdings.count("robot3")
    note(rec("service", "/serve", "/b", "rosrpc://b:5", "http://b:1/", False))
    note(rec("node", "/a", ""))
    assert [holdings.count(robot) for robot in ROBOTS] == [0, 0, 0, 0] and usage.registrations == 0


def test_it_costs_less_memory_than_what_it_counts_weighs():
    """It is for each registration and each parameter of others, so it has to be within their weight."""
    some, number = Some(), 3000
    tracemalloc.start()
    try:
        before = tracemalloc.get_traced_memory()[0]
        for at in range(number):
            some.set(f"/p{at}", 1, "robot2")
            record = rec("publisher", f"/topic{at}", "/node", "http://robot:1/", True)._replace(by="robot2")
            some.holdings.note(record, some.usage.count(record))
        taken = tracemalloc.get_traced_memory()[0] - before
    finally:
        tracemalloc.stop()
    assert taken < some.usage.parameters + some.usage.registrations
    assert bounds.BOUNDS["parameters of one"].most < BOUNDS["parameters"].most / 2
