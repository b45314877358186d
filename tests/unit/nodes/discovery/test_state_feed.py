# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Whole states: each is made once for all who may see the same of it, and is what each of them would be told alone."""

import threading
import time

import pytest
from rosfleet_multimaster.discovery import state_feed as module
from rosfleet_multimaster.discovery.state_feed import CallerView, StateFeed
from rosfleet_multimaster.edge.rpc_client import Rpc
from rosfleet_multimaster.edge.rpc_server import LongPoll, PackedAnswer, RpcServer
from rosfleet_multimaster.protocol.filters import Pattern, Rules
from rosfleet_multimaster.protocol.graph import State, document
from rosfleet_multimaster.protocol.xml_rpc import STATE

URI = "http://own:11311/"
EVERYTHING = Rules()
WITHOUT_ONE = Rules(ignore_topics=Pattern.from_items(["/one"], "ignore_topics"))


def state(*topics, stamp=1.0):
    return State(URI, "own", stamp, stamp, dict.fromkeys(topics, ("/a",)))


class Asked:
    """A discovery that counts the documents that it makes."""

    def __init__(self, ready=list):
        self.made = 0
        self.told = StateFeed(lambda: None, ready)
        self.told.update(state("/one", "/two"), None)

    def ask(self, caller="10.0.0.2", rules=EVERYTHING, epoch="", revision=0):
        def seen(whole):
            self.made += 1
            time.sleep(0.02)  # others ask meanwhile
            return document(whole, [rules])

        return self.told.answer(caller, rules, lambda: CallerView(rules, seen), epoch, revision, 0.0)


def topics(answer):
    return [name for name, _nodes in answer[3][4]]


def test_a_whole_state_is_made_once_for_requests_at_once():
    asked, found = Asked(), []
    threads = [threading.Thread(target=lambda at=at: found.append(asked.ask(f"10.0.0.{at}"))) for at in range(20)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert asked.made == 1 and len(found) == 20 and all(each == found[0] for each in found)
    assert topics(found[0]) == ["/one", "/two"]


def test_other_rules_and_another_state_are_another_document():
    asked = Asked()
    everything, less = asked.ask(), asked.ask(rules=WITHOUT_ONE)
    assert topics(everything) == ["/one", "/two"] and topics(less) == ["/two"] and everything[0] != less[0]
    asked.told.update(state("/one", "/two", "/three", stamp=2.0), None)
    assert topics(asked.ask()) == ["/one", "/two", "/three"] and topics(asked.ask(rules=WITHOUT_ONE)) == [
        "/two",
        "/three",
    ]
    assert asked.made == 4 and topics(asked.ask()) == ["/one", "/two", "/three"] and asked.made == 4


def test_many_filters_take_no_more_room_than_a_few():
    asked = Asked()
    for number in range(3 * module.MOST_READY):
        asked.ask(rules=Rules(ignore_topics=Pattern.from_items([f"/{number}"], "ignore_topics")))
    assert len(asked.told._wholes) == module.MOST_READY and asked.made == 3 * module.MOST_READY


@pytest.mark.parametrize("own", [True, False])
def test_it_travels_as_every_answer_does_packed_or_not(own):
    asked = Asked(PackedAnswer)
    server = RpcServer("127.0.0.1", 0, {"ask": LongPoll(lambda _caller, _may_wait: asked.ask())}, lambda *_why: None)
    rpc = Rpc(f"http://127.0.0.1:{server.server_address[1]}", 10.0, STATE, own=own)
    try:
        answers = [rpc.call("ask") for _time in range(2)]
    finally:
        rpc.close()
        server.stop()
    assert answers[0] == answers[1] and asked.made == 1
    assert answers[0][1:] == Asked().ask()[1:], "all but the epoch, which is another one at each start"


@pytest.mark.slow
def test_digests_of_many_filters_are_not_kept(monkeypatch):
    """A caller may have ever new ones, and the state of a quiet robot stays for days."""
    monkeypatch.setattr(module, "MOST_FILTERS", 10)
    asked = Asked()
    for number in range(25):
        rules = Rules(ignore_topics=Pattern.from_items([f"/{number}"], "ignore_topics"))
        epoch, revision = asked.ask(rules=rules)[:2]
        assert asked.ask(rules=rules, epoch=epoch, revision=revision)[5], "a digest, since nothing is new"
    assert 0 < len(asked.told._digests) <= 10
