# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""A master whose changes are followed: discovery's server and the follower, with sockets on 127.0.0.1."""

import queue
import threading
import time
from dataclasses import replace
from xmlrpc.client import Fault

import pytest
from rosfleet_multimaster.discovery.rpc_methods import RpcMethods, ServedMaster
from rosfleet_multimaster.discovery.state_feed import StateFeed
from rosfleet_multimaster.edge import rpc_server
from rosfleet_multimaster.edge.rpc_client import Rpc
from rosfleet_multimaster.edge.rpc_server import RpcServer
from rosfleet_multimaster.protocol import json_text
from rosfleet_multimaster.protocol.differences import DIFFERENCES, PACKED
from rosfleet_multimaster.protocol.filters import Filters, Pattern, Rules
from rosfleet_multimaster.protocol.graph import ExportPolicy, InvalidDocument, Node, State, document
from rosfleet_multimaster.protocol.wire_filters import write_rules
from rosfleet_multimaster.sync import fetcher, follower, state_room
from rosfleet_multimaster.sync.core.sync import Fetch, Sync
from rosfleet_multimaster.sync.follower import DifferencesAnswer, StateFilter
from rosfleet_multimaster.sync.state_room import StateRoom
from running_sync import until

URI = "http://robot2:11311/"
ASK = write_rules(Filters({}).rules("robot2"), False)


class Discovery:
    """A discovery that serves its state; callers are strangers to it."""

    def __init__(self, told=True, policy=None, is_here=lambda address: True):
        self.own = ServedMaster(URI, "robot2", "/master_discovery", lambda: "127.0.0.1", 1, away="")
        self.told, self.secret = StateFeed(self.own.current), []
        served = RpcMethods(
            self.own, policy or ExportPolicy(), {}, is_here, lambda: self.secret, str, list, self.told if told else None
        )
        self.server = RpcServer("127.0.0.1", 0, served.methods(), lambda *_why: None)
        self.uri = f"http://127.0.0.1:{self.server.server_address[1]}"
        self.asked = []
        self.has({})

    def has(self, publishers):
        """Have these publishers from now on: topic -> node."""
        nodes = {node: Node(f"http://robot2{node}:5000/", URI, "local") for node in publishers.values()}
        stamp = 1.0 if self.own.state is None else self.own.state.stamp + 1.0
        types = dict.fromkeys(publishers, "std_msgs/Int32")
        tables = {topic: (node,) for topic, node in publishers.items()}
        self.own.state = State(URI, "robot2", stamp, stamp, tables, {}, {}, types, nodes)
        self.told.update(self.own.state, self.secret)


@pytest.fixture(name="there")
def _there():
    made = Discovery(is_here=lambda address: False)
    yield made
    made.server.stop()


class Here:
    """A follower of the roscore `there`, with its rules."""

    def __init__(self, there, rules=None):
        self.fetch = Fetch(URI, there.uri, rules or Filters({}).rules("robot2"))
        core = Sync(Filters({}), "http://own:11311/", "/master_sync", False, False, 0.0)
        self.view = StateFilter(self.fetch, core, StateRoom(core.members))
        self.found = fetcher._fetch(self.fetch, None, self.view, True)
        self.states, self.over = queue.Queue(), queue.Queue()
        if self.found.follower is not None:
            self.found.follower.start(lambda *news: self.states.put(news[1]), lambda *why: self.over.put(why[1]))

    def topics(self):
        return sorted(self.states.get(timeout=5).publishers)


def test_a_change_is_told_at_once_and_alone(there):
    there.has({"/a": "/one"})
    here, took = Here(there), []
    assert sorted(here.found.state.publishers) == ["/a"] and here.found.follower._method == PACKED
    for number in range(5):  # four threads hand it on: other programs can only make one of them later
        time.sleep(0.05)
        began = time.monotonic()
        there.has({"/a": "/one", f"/b{number}": "/two"})
        assert here.topics() == ["/a", f"/b{number}"]
        took.append(time.monotonic() - began)
    assert min(took) < 0.2
    there.has({"/b": "/two"})
    assert here.topics() == ["/b"]
    here.found.follower.stop()


@pytest.mark.slow
def test_to_wait_for_a_processor_delays_nothing_else(there, monkeypatch):
    """An answer that costs much makes a pause. One that only lay there does not: it would be one more delay."""
    monkeypatch.setattr(follower, "size", lambda state: time.sleep(0.5) or 1)
    here = Here(there)
    there.has({"/a": "/one"})
    assert here.topics() == ["/a"]
    time.sleep(0.1)
    began = time.monotonic()
    there.has({"/a": "/one", "/b": "/two"})
    assert here.topics() == ["/a", "/b"]
    assert time.monotonic() - began < 1.5, "0.5 s, and not four times as long before"
    here.found.follower.stop()


def test_a_filter_hides_on_the_quick_way_too_and_stamps_move(there):
    there.has({"/a": "/one"})
    here = Here(there, Filters({"ignore_topics": ["/hidden*"]}).rules("robot2"))
    there.has({"/a": "/one", "/hidden": "/two"})
    state = here.states.get(timeout=5)
    assert sorted(state.publishers) == ["/a"] and state.local_stamp == there.own.state.local_stamp
    here.found.follower.stop()


def test_what_becomes_secret_is_gone_at_once(there):
    there.has({"/a": "/one", "/b": "/two"})
    here = Here(there)
    there.secret = ["/b"]
    there.told.update(there.own.state, there.secret)
    assert here.topics() == ["/a"]
    here.found.follower.stop()


@pytest.mark.parametrize("has", [PACKED, DIFFERENCES, ""])
def test_the_best_way_that_it_has_is_taken(there, has):
    there.has({"/a": "/one"})
    methods = there.server.methods
    names = sorted(set(methods) - {PACKED, DIFFERENCES} | {has})
    methods["system.listMethods"] = lambda: names
    for gone in {PACKED, DIFFERENCES} - {has}:
        del methods[gone]
    here = Here(there)
    assert sorted(here.found.state.publishers) == ["/a"] and (here.found.follower is None) == (not has)
    if has:
        assert here.found.follower._method == has
        here.found.follower.stop()


def test_a_large_state_travels_as_xml_and_is_followed(there, monkeypatch):
    monkeypatch.setattr(json_text, "MOST", 1000)
    there.has({f"/a/{number}": "/one" for number in range(100)})
    here = Here(there)
    assert len(here.found.state.publishers) == 100 and here.found.follower._method == PACKED
    there.has({"/b": "/one"})
    assert here.topics() == ["/b"]
    here.found.follower.stop()


def test_where_the_quick_way_is_off_the_whole_is_fetched():
    there = Discovery(told=False, is_here=lambda address: False)
    there.has({"/a": "/one"})
    here = Here(there)
    assert sorted(here.found.state.publishers) == ["/a"] and here.found.follower is None
    there.server.stop()


def test_a_discovery_that_goes_ends_it_and_a_stop_is_quiet(there):
    here, other = Here(there), Here(there)
    other.found.follower.stop()
    time.sleep(0.1)
    there.own.away = "its roscore does not answer"
    there.told.update(there.own.state, ["wake"])
    assert isinstance(here.over.get(timeout=5), Fault)
    assert other.over.empty()


def test_a_filter_that_was_forgotten_is_asked_for(there):
    with pytest.raises(Fault, match="not known any more"):
        Rpc(there.uri, 5.0).call(DIFFERENCES, [], "another start", 1, 0)


@pytest.mark.parametrize("asked", [([], 1, 1, 0), (ASK, "", "1", 0), (ASK, "", 1, None), ("", "", 1, 0), (ASK,)])
def test_a_question_that_is_none_is_refused(there, asked):
    with pytest.raises(Fault):
        Rpc(there.uri, 5.0).call(DIFFERENCES, *asked)


@pytest.mark.slow
def test_one_robot_keeps_few_connections(there):
    rpcs = [Rpc(there.uri, 5.0) for _count in range(rpc_server._KEPT_OF_ONE + 2)]
    known = rpcs[0].call(DIFFERENCES, ASK, "", 0, 0)[:2]
    answers = []
    threads = [
        threading.Thread(target=lambda rpc=rpc: answers.append(rpc.call(DIFFERENCES, ASK, *known, 2.0))) for rpc in rpcs
    ]
    began = time.monotonic()
    for thread in threads:
        thread.start()
    for thread in threads[-2:] + threads[:-2]:
        thread.join(5)
    assert len(answers) == len(rpcs) and 1.9 < time.monotonic() - began < 4.0
    assert sum(connection.kept for connection in there.server._open.values()) <= rpc_server._KEPT_OF_ONE
    assert all(answer[2] is False and answer[5] for answer in answers), "nothing new, and a digest"
    Rpc(there.uri, 5.0).call("masterContacts")  # there is still room for the other methods


def test_a_digest_that_differs_takes_the_whole(there, monkeypatch):
    monkeypatch.setattr(follower, "WAIT", (0.05, 0.06))
    there.has({"/a": "/one"})
    here = Here(there)
    here.found.follower._state = replace(here.found.state, publishers={"/other": ("/one",)})
    assert here.topics() == ["/a"]
    here.found.follower.stop()


# A hostile one


@pytest.mark.parametrize(
    "value",
    [
        None,
        [],
        ["e", 1, True, [], []],
        ["", 1, True, [], [], ""],
        ["e" * 100, 1, True, [], [], ""],
        ["e", "1", 1, 1, 1, 1],
    ],
)
def test_what_is_no_answer_is_refused(value):
    with pytest.raises(InvalidDocument):
        DifferencesAnswer(value)


def test_a_state_that_grows_and_grows_is_not_followed(there, monkeypatch):
    monkeypatch.setattr(state_room, "MOST_FOLLOWED", 3)
    here = Here(there)
    there.has({f"/topic{number}": "/one" for number in range(5)})
    assert isinstance(here.over.get(timeout=5), follower.StateTooLarge)


def test_a_difference_of_another_master_ends_it(there):
    here = Here(there)
    there.own.state = replace(there.own.state, uri="http://robot3:11311/", stamp=99.0, local_stamp=99.0)
    there.told.update(there.own.state, [])
    assert isinstance(here.over.get(timeout=5), InvalidDocument)


def test_the_state_of_another_master_is_named(there):
    there.own.state = replace(there.own.state, uri="http://robot3:11311/")
    there.told.update(there.own.state, [])
    with pytest.raises(ValueError, match=f"it is about http://robot3:11311/, and not about {URI}"):
        Here(there)


def test_the_document_of_a_whole_answer_is_that_of_the_old_way(there):
    there.has({"/a": "/one", "/b": "/two"})
    rpc = Rpc(there.uri, 5.0)
    quick, old = rpc.call(DIFFERENCES, ASK, "", 0, 0), rpc.call("masterInfoFiltered", ASK)
    assert quick[2] is True and quick[3] == old == document(there.own.state, [Rules(), Rules(do_not_sync=Pattern())])


def test_a_third_robots_topics_are_told_to_subscribers_alone(there):
    there.has({"/a": "/one"})
    there.own.state = replace(there.own.state, subscribers={"/heard": ("/one",)}, stamp=3.0, local_stamp=3.0)
    there.told.update(there.own.state, there.secret)
    here, state = Here(there), there.own.state
    until(lambda: there.told._changed._waiters)  # it waits for news
    third = Node("http://robot3:5000/", "http://robot3:11311/", "remote")
    there.own.state = replace(
        state,
        stamp=4.0,
        publishers={**state.publishers, "/far": ("/third",), "/heard": ("/third",)},
        subscribers={"/heard": ("/one", "/third")},
        services={"/ask": ("/third",)},
        providers={"/ask": Node("rosrpc://robot3:1", third.origin, "remote")},
        nodes={**state.nodes, "/third": third},
    )
    there.told.update(there.own.state, there.secret)
    time.sleep(0.3)
    assert here.states.empty(), "nobody is woken for it"
    there.own.state = replace(there.own.state, local_stamp=5.0)
    there.told.update(there.own.state, there.secret)
    told = here.states.get(timeout=5)
    assert dict(told.publishers) == {"/a": ("/one",), "/heard": ("/third",)} and not told.services
    assert dict(told.subscribers) == {"/heard": ("/one",)} and sorted(told.nodes) == ["/one", "/third"]
    here.found.follower.stop()


def test_many_changes_of_third_robots_are_no_answers(there):
    there.has({"/a": "/one"})
    epoch, revision = Rpc(there.uri, 5.0).call(DIFFERENCES, ASK, "", 0, 0)[:2]
    third = Node("http://robot3:5000/", "http://robot3:11311/", "remote")
    for number in range(50):
        publishers = {**there.own.state.publishers, f"/far{number}": ("/third",)}
        nodes = {**there.own.state.nodes, "/third": third}
        there.own.state = replace(there.own.state, stamp=10.0 + number, publishers=publishers, nodes=nodes)
        there.told.update(there.own.state, there.secret)
    began = time.monotonic()
    answer = Rpc(there.uri, 5.0).call(DIFFERENCES, ASK, epoch, revision, 0.5)
    assert time.monotonic() - began >= 0.5 and answer[0] == epoch and answer[1] == revision + 50
    assert not any(answer[3][4:]) and answer[4] == [[], [], []]
