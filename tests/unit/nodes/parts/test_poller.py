# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The poller before a roscore that this file plays."""

import types

import pytest
from rosfleet_multimaster.parts import poller as module
from rosfleet_multimaster.parts.own_roscore import Identity

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


def test_the_first_state_waits_too_until_it_is_known_what_is_from_where():
    answers = []
    poller = module.Poller(Roscore(), URI, "robot1", Identity(), lambda service: answers[0])
    with pytest.raises(OSError):
        poller.poll()
    answers.append({FAR: R2})
    assert poller.poll().nodes["/far"].origin == R2


def test_the_first_state_does_not_wait_for_ever(monkeypatch):
    clock = [100.0]
    monkeypatch.setattr(module, "monotonic", lambda: clock[0])
    poller = module.Poller(Roscore(), URI, "robot1", Identity(), lambda service: 1 / 0)
    with pytest.raises(OSError):
        poller.poll()
    clock[0] += module.POSTPONE + 0.1
    assert poller.poll().nodes["/far"].origin == URI


class Quiet(Roscore):
    """Its answers are the same bytes again, until something changes."""

    def __init__(self):
        self.topics, self.types, self.uris, self.reads, self.asked = ["/one"], [], {}, 0, 0

    def ask(self, *calls, last=None):
        self.asked += 1
        if last is None:
            values = {"getTopicTypes": self.types}
            return [self.uris.get(call[1]) if call[0] == "lookupNode" else values.get(call[0]) for call in calls]
        if last.is_again(repr(calls).encode(), bytearray(repr(self.topics).encode())):
            return []
        self.reads += 1
        return [1, None, [[[topic, ["/a"]] for topic in self.topics], [], []]]


@pytest.fixture(name="clock")
def _clock(monkeypatch):
    now = [100.0]
    monkeypatch.setattr(module, "monotonic", lambda: now[0])
    return now


def quiet():
    roscore = Quiet()
    return roscore, module.Poller(roscore, URI, "robot1", Identity(), lambda service: {})


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


def test_what_is_no_registration_is_looked_at_now_and_then(clock):
    roscore, poller = quiet()
    first = poller.poll()
    roscore.types, roscore.uris = [["/one", "x/Y"]], {"/a": "http://robot1:7/"}
    assert poller.poll() is first
    clock[0] += module.REST
    state = poller.poll()
    assert state.types == {"/one": "x/Y"} and state.nodes["/a"].uri == "http://robot1:7/" and roscore.reads == 1


def test_an_answer_that_could_not_be_made_a_state_is_read_again(clock, monkeypatch):
    roscore, poller = quiet()
    poller.poll()
    roscore.topics = ["/one", "/two"]
    with monkeypatch.context() as patch:
        patch.setattr(module, "graph_of", lambda *answers: 1 / 0)
        with pytest.raises(ZeroDivisionError):
            poller.poll()
    assert sorted(poller.poll().publishers) == ["/one", "/two"]


def test_every_node_is_looked_up_again_in_its_turn(clock):
    names, known = [f"/{number}" for number in range(250)], {}
    assert sorted(module._some(names, known, 0)) == sorted(names)
    known.update(dict.fromkeys([*names, "/gone"], "http://x:1/"))
    seen = [name for turn in range(3) for name in module._some(names, known, turn)]
    assert set(seen) == set(names) and "/gone" not in known and all(seen.count(name) <= 2 for name in names)
