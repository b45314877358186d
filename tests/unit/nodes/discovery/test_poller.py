# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The poller before a roscore that this file plays."""

import math
import types

import pytest
from rosfleet_multimaster.discovery import poller as module
from rosfleet_multimaster.edge.local_roscore import Identity
from rosfleet_multimaster.edge.process import program
from rosfleet_multimaster.protocol.differences import Stamps
from rosfleet_multimaster.protocol.graph import State

URI, R2 = "http://robot1:11311/", "http://robot2:11311/"
SYNC, FAR = ("/upstream_sync", "http://robot1:1/"), ("/far", "http://robot2:2/")


class Roscore:
    """With a node that another implementation of master_sync registered."""

    rpc = types.SimpleNamespace(uri=URI)

    def ask(self, *calls, last=None):
        nodes = dict([SYNC, FAR])
        answers = {
            "getPid": 1,
            "getTopicTypes": [["/chatter", "std_msgs/String"]],
            "getSystemState": [[["/chatter", ["/far"]]], [], [["/upstream_sync/get_sync_info", ["/upstream_sync"]]]],
            "lookupService": "rosrpc://robot1:3",
        }
        return [nodes.get(call[1]) if call[0] == "lookupNode" else answers.get(call[0]) for call in calls]


def test_the_first_state_waits_until_origins_are_known():
    answers = []
    poller = module.Poller(Roscore(), State(URI, "robot1"), Identity(), lambda service: answers[0], Stamps())
    with pytest.raises(OSError):
        poller.poll()
    answers.append({FAR: R2})
    assert poller.poll().nodes["/far"].origin == R2


def test_the_first_state_does_not_wait_for_ever(monkeypatch):
    clock = [100.0]
    monkeypatch.setattr(module, "monotonic", lambda: clock[0])
    poller = module.Poller(Roscore(), State(URI, "robot1"), Identity(), lambda service: 1 / 0, Stamps())
    with pytest.raises(OSError):
        poller.poll()
    clock[0] += module.POSTPONE + 0.1
    assert poller.poll().nodes["/far"].origin == URI


class Quiet(Roscore):
    """Its answers are the same bytes again, until something changes."""

    def __init__(self):
        self.topics, self.types, self.uris, self.pid = ["/one"], [], {}, 1
        self.reads, self.rest_reads, self.asked = 0, 0, 0

    def ask(self, *calls, last=None):
        self.asked += 1
        values = {
            "getSystemState": [[[topic, ["/a"]] for topic in self.topics], [], []],
            "getTopicTypes": self.types,
            "getPid": self.pid,
        }
        answers = [self.uris.get(call[1]) if call[0] == "lookupNode" else values.get(call[0]) for call in calls]
        if last.is_again(repr(calls).encode(), bytearray(repr(answers).encode())):
            return []
        if len(calls) == 1:
            self.reads += 1
        else:
            self.rest_reads += 1
        return answers


@pytest.fixture(name="clock")
def _clock(monkeypatch):
    now = [100.0]
    monkeypatch.setattr(module, "monotonic", lambda: now[0])
    return now


def quiet():
    roscore = Quiet()
    return roscore, module.Poller(roscore, State(URI, "robot1"), Identity(), lambda service: {}, Stamps())


def test_an_answer_that_is_the_last_one_again_is_not_read(clock):
    roscore, poller = quiet()
    first = poller.poll()
    asked = roscore.asked
    assert poller.poll() is first and roscore.reads == 1 and roscore.asked == asked + 1
    roscore.topics = ["/one", "/two"]
    second = poller.poll()
    assert sorted(second.publishers) == ["/one", "/two"] and roscore.reads == 2 and poller.poll() is second
    roscore.topics = ["/one"]
    assert sorted(poller.poll().publishers) == ["/one"]


def test_odd_registrations_are_looked_at_now_and_then(clock):
    roscore, poller = quiet()
    first = poller.poll()
    roscore.types, roscore.uris = [["/one", "x/Y"]], {"/a": "http://robot1:7/"}
    assert poller.poll() is first
    clock[0] += module.REST
    state = poller.poll()
    assert state.types == {"/one": "x/Y"} and state.nodes["/a"].uri == "http://robot1:7/" and roscore.reads == 1
    for _look in range(5):
        clock[0] += module.REST
        assert poller.poll() is state
    assert roscore.rest_reads == 2, "an answer that is the last one again is not read"


def test_what_costs_much_is_looked_at_seldom(clock):
    roscore, poller = quiet()
    poller.poll()
    ask, rests = roscore.ask, []

    def slow(*calls, last=None):
        if len(calls) > 1:
            rests.append(clock[0])
            clock[0] += 0.02
        return ask(*calls, last=last)

    roscore.ask = slow
    poller._rest_pace = module.PollPace(module.REST)
    while clock[0] < 130.0:
        clock[0] += 0.1
        poller.poll()
    assert 12 <= len(rests) <= 16, "one part in a hundred of the time"


def test_a_roscore_that_forgot_this_node_ends_it_late_too(clock):
    roscore, poller = quiet()
    poller._identity.service = ("/own/service", "rosrpc://robot1:3")
    with pytest.raises(program.Fatal):
        poller.poll()


def test_an_answer_that_could_not_be_made_a_state_is_read_again(clock, monkeypatch):
    roscore, poller = quiet()
    poller.poll()
    roscore.topics = ["/one", "/two"]
    with monkeypatch.context() as patch:
        patch.setattr(module, "graph_of", lambda *answers: 1 / 0)
        with pytest.raises(ZeroDivisionError):
            poller.poll()
    assert sorted(poller.poll().publishers) == ["/one", "/two"]


@pytest.mark.parametrize("count", [30, 100, 250])
def test_every_node_is_looked_up_again_in_its_turn(clock, count):
    roscore, poller = quiet()
    names = [f"/{number}" for number in range(count)]
    graph = State("http://own:11311/", "own", publishers={"/one": tuple(names)})
    assert sorted(name for _method, name in poller._select_lookups(graph)[1]) == sorted(names)
    poller._node_uris.update(dict.fromkeys([*names, "/gone"], "http://x:1/"))
    turns = [poller._select_lookups(graph) for _turn in range(math.ceil(count / module.LOOKUPS))]
    assert sorted(name for _turn, asked in turns for _method, name in asked) == sorted(names)
    assert "/gone" not in poller._node_uris and all(len(asked) <= module.LOOKUPS for _turn, asked in turns)
    assert poller._select_lookups(graph) == turns[0], "the same question again, so that its answer can be the same"
