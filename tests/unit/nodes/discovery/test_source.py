# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The source of states: a roscore that tells, one that does not, and one that goes and comes back."""

import queue
import threading
import time
import types
import xmlrpc.client
from socketserver import ThreadingMixIn
from xmlrpc.server import SimpleXMLRPCRequestHandler, SimpleXMLRPCServer

import pytest
from mentioned import mentions
from rosfleet_multimaster.discovery import source as source_module
from rosfleet_multimaster.discovery.poller import Poller
from rosfleet_multimaster.discovery.source import Source, StateFollower, start_source_thread
from rosfleet_multimaster.edge.local_roscore import Identity
from rosfleet_multimaster.edge.loop import EndFlag
from rosfleet_multimaster.edge.process import program
from rosfleet_multimaster.edge.roscore import Roscore as Master
from rosfleet_multimaster.protocol.differences import Stamps
from rosfleet_multimaster.protocol.graph import State
from rosfleet_multimaster.protocol.json_text import pack_rows
from rosfleet_multimaster.protocol.mirror import CHANGES, Mirror

URI = "http://own:11311/"
SERVICE = ("/master_discovery/list_masters", "rosrpc://own:5")
WHOLE = [
    ["service", SERVICE[0], "/master_discovery", SERVICE[1]],
    ["node", "/master_discovery", "http://own:4/"],
    ["publisher", "/one", "/a", True],
    ["node", "/a", "http://own:1/"],
    ["parameter", "/do_not_sync", ["/secret"]],
]


class Kept(SimpleXMLRPCRequestHandler):
    protocol_version = "HTTP/1.1"


class Server(ThreadingMixIn, SimpleXMLRPCServer):
    daemon_threads, block_on_close = True, False


class Roscore:
    """Answers with what the test puts into its queue."""

    def __init__(self):
        self.answers, self.asked = queue.Queue(), []
        self.server = Server(("127.0.0.1", 0), Kept, logRequests=False)
        self.server.register_function(lambda: [CHANGES, "getPid"], "system.listMethods")
        self.server.register_function(self.changes, CHANGES)
        self.uri = f"http://127.0.0.1:{self.server.server_address[1]}"
        threading.Thread(target=self.server.serve_forever, args=(0.05,), daemon=True).start()

    def changes(self, _caller, epoch, revision, _wait, in_texts):
        assert in_texts is True
        self.asked.append((epoch, revision))
        answer = self.answers.get(timeout=5)
        if isinstance(answer, Exception):
            raise answer
        return answer

    def tell(self, epoch, revision, whole, records):
        self.answers.put([1, "changes", [epoch, revision, whole, pack_rows(records)]])


@pytest.fixture(name="roscore")
def _roscore():
    made = Roscore()
    yield made
    made.server.shutdown()
    made.server.server_close()


def source_of(roscore, identity=None, tells=True):
    identity, stamps = identity or Identity(), Stamps()
    poller = types.SimpleNamespace(
        roscore=types.SimpleNamespace(
            has=lambda method: tells and method == CHANGES, rpc=types.SimpleNamespace(uri=roscore.uri)
        ),
        poll=lambda: State(URI, "polled"),
        do_not_sync=["/polled"],
    )
    return Source(
        poller, lambda: StateFollower(roscore.uri, "/master_discovery", Mirror(URI, "own"), identity, stamps), 0.5
    )


def test_a_bundled_roscores_feed_replaces_polling(roscore):
    source = source_of(roscore)
    roscore.tell("e", 7, True, WHOLE)
    state = source.next()
    assert dict(state.publishers) == {"/one": ("/a",)} and source.do_not_sync == ["/secret"] and not source.pause
    roscore.tell("e", 8, False, [["publisher", "/two", "/a", True]])
    assert sorted(source.next().publishers) == ["/one", "/two"]
    roscore.tell("e", 8, False, [])
    same = source.next()
    roscore.tell("e", 8, False, [])
    assert source.next() is same, "no news, no other stamps"
    assert roscore.asked == [("", 0), ("e", 7), ("e", 8), ("e", 8)]


def test_secret_topics_stay_known_while_the_roscore_is_away(roscore):
    source = source_of(roscore)
    roscore.tell("e", 7, True, WHOLE)
    source.next()
    roscore.answers.put([1, "changes", "no changes"])
    with pytest.raises(ValueError, match="unpack"):
        source.next()
    assert source.do_not_sync == ["/secret"], "the state of before is served for a moment"


def test_imports_are_of_their_master(roscore):
    record = (
        '{"node": "/master_sync", "uri": "http://own:3/", "imports": {"http://far:11311/": {"/far": "http://far:1/"}}}'
    )
    source = source_of(roscore)
    told = [["publisher", "/far/one", "/far", True], ["node", "/far", "http://far:1/"]]
    roscore.tell("e", 1, True, [*WHOLE, *told, ["parameter", "/rosfleet_multimaster/imports", record]])
    assert source.next().nodes["/far"].origin == "http://far:11311/"


def test_any_other_roscore_is_polled(roscore):
    source = source_of(roscore, tells=False)
    assert source.next().name == "polled" and source.do_not_sync == ["/polled"] and source.pause > 0.4


@pytest.mark.parametrize("more", [[-1, "8 callers wait already", 0], None])
def test_where_it_does_not_tell_or_is_not_enough_it_is_polled(roscore, more, caplog):
    caplog.set_level("INFO")
    if more is None:
        more = [
            1,
            "",
            ["e", 1, True, [*WHOLE, ["service", "/other_sync/get_sync_info", "/other_sync", "rosrpc://own:6"]]],
        ]
    roscore.answers.put(more)
    source = source_of(roscore)
    assert source.next().name == "polled" and source.next().name == "polled" and len(roscore.asked) == 1
    assert mentions(caplog.text, "roscore", roscore.uri)


def test_after_a_start_of_sync_it_is_listened_to_again_soon(roscore, monkeypatch):
    monkeypatch.setattr(source_module, "AGAIN", 0.2)
    other = ["service", "/master_sync/get_sync_info", "/master_sync", "rosrpc://own:6"]
    roscore.tell("e", 1, True, [*WHOLE, other, ["node", "/master_sync", "http://own:3/"]])
    source = source_of(roscore)
    assert source.next().name == "polled", "the record is of its earlier life"
    record = '{"node": "/master_sync", "uri": "http://own:3/", "imports": {}}'
    here = [*WHOLE, other, ["node", "/master_sync", "http://own:3/"]]
    roscore.tell("e", 2, True, [*here, ["parameter", "/rosfleet_multimaster/imports", record]])
    deadline = time.monotonic() + 5
    while source.next().name == "polled":
        assert time.monotonic() < deadline
        time.sleep(0.05)
    assert source.do_not_sync == ["/secret"] and len(roscore.asked) == 2


def test_this_node_goes_on_unless_the_roscore_forgot_it(roscore):
    identity = Identity()
    source = source_of(roscore, identity)
    roscore.tell("e", 7, True, WHOLE)
    first = source.next()
    identity.service = SERVICE
    roscore.tell("f", 1, True, WHOLE)
    assert source.next() is first
    roscore.tell("g", 1, True, WHOLE[1:])
    with pytest.raises(program.Fatal, match="no longer"):
        source.next()


def test_an_answer_that_is_none_is_no_end(roscore):
    source = source_of(roscore)
    roscore.answers.put("nonsense")
    assert source.next().name == "polled"
    source = source_of(roscore)
    roscore.tell("e", 7, True, WHOLE)
    source.next()
    roscore.answers.put(OSError())  # a fault
    assert source.next().name == "polled"


def test_after_a_broken_connection_it_is_asked_what_it_can(roscore):
    source = source_of(roscore)
    roscore.tell("e", 7, True, WHOLE)
    source.next()
    source._follower._rpc._port = 1
    source._follower._rpc.close()
    with pytest.raises(OSError):
        source.next()
    roscore.tell("h", 1, True, WHOLE)
    assert source.next().publishers and roscore.asked[-1] == ("", 0)


def test_an_identity_by_process_id():
    identity = Identity()
    assert identity.check(SERVICE, 1, SERVICE[1]) is False
    assert identity.check(SERVICE, 2, SERVICE[1]) is True, "restarted, with its memory"
    with pytest.raises(program.Fatal, match="no longer"):
        identity.check(SERVICE, 3, None)
    identity = Identity()
    assert identity.check(("", ""), 1, None) is False and identity.check(("", ""), 2, None) is True, "it has none yet"


def test_rosmaster_tells_no_changes():
    def fault(_method):
        raise xmlrpc.client.Fault(1, "no such method")

    roscore = Master(URI, "/own")
    roscore.rpc = types.SimpleNamespace(call=fault)
    assert Poller(roscore, State(URI, "own"), Identity(), dict, Stamps()).roscore.has(CHANGES) is False


def test_nobody_is_woken_for_a_poll_that_brought_nothing():
    one, two = State(URI, "one"), State(URI, "two")
    told, ended = [], EndFlag()
    polls = iter([one, one, OSError(), one, one, two, two])

    def following():
        try:
            found = next(polls)
        except StopIteration:
            ended.set()
            return two
        if isinstance(found, Exception):
            raise found
        return found

    source = types.SimpleNamespace(next=following, do_not_sync=None, pause=0.001)
    loop = types.SimpleNamespace(post=lambda function, *arguments: function(*arguments))
    start_source_thread(source, loop, ended, lambda state, _secret: told.append(state), lambda *_why: None)
    ended.wait(10)
    time.sleep(0.05)
    assert told == [one, one, two], "and again after a failure, which had said that there is no state"
