# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Hostile peers on the quick way: one that answers questions for differences, and one that asks them. Sockets on 127.0.0.1."""

import gzip
import json
import queue
import socket
import threading
import time
import xmlrpc.client
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import hostile_inputs
import pytest
from drawn import drawn
from hypothesis import given, settings
from hypothesis import strategies as st
from rosfleet_multimaster.discovery import state_feed
from rosfleet_multimaster.discovery.rpc_methods import RpcMethods, ServedMaster
from rosfleet_multimaster.discovery.state_feed import StateFeed
from rosfleet_multimaster.edge.patience import BURST, EARLY, RATE, WHOLE
from rosfleet_multimaster.edge.rpc_client import Rpc
from rosfleet_multimaster.edge.rpc_server import RpcServer
from rosfleet_multimaster.protocol.differences import DIFFERENCES, PACKED, apply_difference
from rosfleet_multimaster.protocol.filters import Filters
from rosfleet_multimaster.protocol.graph import ExportPolicy, InvalidDocument, Node, State, document
from rosfleet_multimaster.protocol.members import Members
from rosfleet_multimaster.protocol.messages import AnnouncedMaster
from rosfleet_multimaster.protocol.wire_filters import write_rules
from rosfleet_multimaster.protocol.xml_rpc import STATE
from rosfleet_multimaster.sync import fetcher
from rosfleet_multimaster.sync import follower as module
from rosfleet_multimaster.sync.core.sync import Fetch, Sync
from rosfleet_multimaster.sync.follower import DifferencesAnswer, StateFilter
from rosfleet_multimaster.sync.state_room import MOST_FOLLOWED, StateRoom

URI, OWN = "http://robot2:11311/", "http://own:11311/"
NODE = Node("http://robot2:5000/", URI, "local")
TRUE = State(URI, "robot2", 1.0, 1.0, {"/a": ("/one",)}, {}, {}, {"/a": "x/Y"}, {"/one": NODE})
NOTHING = [[], [], []]
WAIT = module.WAIT  # seconds, as in use
ASK = write_rules(Filters({}).rules("robot2"), False)


def rows(**parts):
    """A document with these parts, and else nothing."""
    names = ("publishers", "subscribers", "services", "types", "nodes", "providers")
    return ["2.0", "2.0", parts.pop("uri", URI), "robot2", *(parts.get(name, []) for name in names)]


class Peer:
    """A discovery that answers the first question for differences truly, and then as the test says."""

    def __init__(self, answer, method):
        """`answer(questions so far)`: the values of the answer, or bytes with all of HTTP. `method`: the one that it has."""
        self.asked, peer, own = [], self, method

        class Handler(BaseHTTPRequestHandler):
            protocol_version = "HTTP/1.1"
            disable_nagle_algorithm = True

            def do_POST(self):
                arguments, method = xmlrpc.client.loads(self.rfile.read(int(self.headers["Content-Length"])))
                found = [own] if method != own else peer.next(arguments, answer)
                if own == PACKED and method == own and isinstance(found, list):
                    found = json.dumps(found)
                if isinstance(found, bytes):
                    self.wfile.write(found)
                    self.close_connection = True
                    return
                if callable(found):
                    found(self.wfile)
                    return
                body = xmlrpc.client.dumps((found,), methodresponse=True, allow_none=True).encode()
                self.send_response(200)
                self.send_header("Content-Length", str(len(body)))
                self.end_headers()
                self.wfile.write(body)

            def log_message(self, *_arguments):
                pass

        self.server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.server.daemon_threads, self.server.block_on_close = True, False
        self.uri = f"http://127.0.0.1:{self.server.server_address[1]}"
        threading.Thread(target=self.server.serve_forever, args=(0.05,), daemon=True).start()

    def next(self, arguments, answer):
        self.asked.append(arguments)
        return ["e", 1, True, document(TRUE), NOTHING, ""] if len(self.asked) == 1 else answer(self.asked)


@pytest.fixture(name="following", params=[DIFFERENCES, PACKED])
def _following(monkeypatch, request):
    """Follow a hostile peer, on each of the two ways: (peer, states, why it is over)."""
    monkeypatch.setattr(module, "TIMEOUT", 0.3)
    monkeypatch.setattr(module, "WAIT", (0.2, 0.3))
    made = []

    def follow(answer):
        peer, states, over = Peer(answer, request.param), queue.Queue(), queue.Queue()
        fetch = Fetch(URI, peer.uri, Filters({}).rules("robot2"))
        found = fetcher._fetch(
            fetch,
            None,
            StateFilter(fetch, Sync(Filters({}), OWN, "/master_sync", False, False, 0.0), StateRoom(Members())),
            True,
        )
        found.follower.start(lambda *news: states.put(news[1]), lambda *why: over.put(why[1]))
        made.append((peer, found.follower))
        return peer, states, over

    yield follow
    for peer, follower in made:
        follower.stop()
        peer.server.shutdown()
        peer.server.server_close()


@pytest.fixture
def unhurried(following, monkeypatch):
    """The peer of this test answers, and a busy machine may take its time for that: 0.1 s are early, as with a real wait."""
    monkeypatch.setattr(module, "TIMEOUT", 30.0)
    monkeypatch.setattr(module, "WAIT", WAIT)


def ok(body, head=""):
    return f"HTTP/1.1 200 OK\r\nContent-Length: {len(body)}\r\n{head}\r\n".encode() + body


def drip(wfile):
    wfile.write(b"HTTP/1.1 200 OK\r\nContent-Length: 100000\r\n\r\n")
    try:
        while True:
            wfile.write(b" ")
            wfile.flush()
            time.sleep(0.05)
    except OSError:
        pass


BOMB = gzip.compress(b"<value>" * (STATE // 7 + 1000), mtime=0)
MANY = [[f"/flood/{number}", ["/one"]] for number in range(MOST_FOLLOWED + 1)]


@pytest.mark.slow
@pytest.mark.parametrize(
    "answer",
    [
        ok(BOMB, "Content-Encoding: gzip\r\n"),
        ok(b"x"),
        b"HTTP/1.1 500 No\r\n\r\n",
        drip,
        None,
        7,
        ["e", 2, False, rows(uri="http://robot3:11311/"), NOTHING, ""],
        ["e", 2, False, rows(publishers=MANY), NOTHING, ""],
        ["e", 2, False, rows(publishers=[["/b", "/one"]]), NOTHING, ""],
        ["e", 2, False, rows(), [[], []], ""],
        ["e", 2, False, rows(), [[1], [], []], ""],
        ["e", "2", False, rows(), NOTHING, ""],
        ["", 2, True, rows(), NOTHING, ""],
        ["e", 2, 0, rows(), NOTHING, ""],
        ["e", 2, False, rows(nodes=[["/one", "http://x:1/", URI, 1]]), NOTHING, ""],
    ],
    ids=lambda answer: getattr(answer, "__name__", repr(answer)[:40]),
)
def test_a_malformed_difference_ends_the_following(following, answer):
    _peer, states, over = following(lambda _asked: answer)
    problem = over.get(timeout=10)
    assert states.empty() and len(str(problem)) < 500


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["empty", "news", "replays", "wholes"])
def test_however_fast_it_answers_it_is_asked_at_the_pace(following, unhurried, kind):
    def answer(asked):
        number = len(asked)
        topic = f"/b{number % 2}"
        busy = rows(
            publishers=[[topic, ["/one"]]],
            types=[[topic, "x/Y"]],
            nodes=[["/one", NODE.uri, URI, 1, "local"]],
        )
        answers = {
            "empty": ["e", 1, False, rows(), NOTHING, ""],
            "news": ["e", number, False, busy, [[f"/b{(number + 1) % 2}"], [], []], ""],
            "replays": ["e", 1, False, busy, NOTHING, ""],
            "wholes": [f"e{number}", number, True, busy, NOTHING, ""],
        }
        return answers[kind]

    began = time.monotonic()
    peer, _states, over = following(answer)
    time.sleep(2.0)
    asked, took = len(peer.asked), time.monotonic() - began  # in this order: on a busy machine time passes in between
    most = {"empty": 2 + took / EARLY, "wholes": 4 + took * RATE / WHOLE}.get(kind, BURST + RATE * took + 2)
    assert over.empty() and asked <= most


@pytest.mark.slow
def test_a_digest_that_never_fits_costs_single_whole_states(following, unhurried):
    def answer(asked):
        for_all = asked[-1][1] == ""
        return ["e", 1, True, document(TRUE), NOTHING, ""] if for_all else ["e", 1, False, rows(), NOTHING, "0" * 32]

    began = time.monotonic()
    peer, _states, over = following(answer)
    time.sleep(2.0)
    asked, took = len(peer.asked), time.monotonic() - began
    assert over.empty() and asked <= 4 + 2 * took * RATE / WHOLE  # each whole is followed by one that does not fit


values = drawn(hostile_inputs.value)
documents = drawn(hostile_inputs.state, [URI, OWN], ["/a", "/b", "/own", "/one"], ["http://robot2:5000/"])


@settings(max_examples=200, deadline=None)
@given(documents | values, st.lists(st.lists(values, max_size=2), max_size=4) | values)
def test_any_difference_is_a_state_of_its_master_or_malformed(told_rows, gone):
    try:
        state = DifferencesAnswer(["e", 1, False, told_rows, gone, ""]).state(TRUE)
    except InvalidDocument:
        return
    assert state.uri == URI
    core = Sync(Filters({}), OWN, "/master_sync", False, False, 0.0)
    core.take_announcement(AnnouncedMaster("robot2", URI, "http://robot2:11611/", "/d", 1.0, 1.0, True), 0.0)
    (fetch,) = core.due(1.0)
    core.take_fetch(fetch, TRUE, 1.0)
    core.take_change(URI, state, {})
    for item in core.candidates(2.0):
        assert item.registration.node in state.nodes and state.nodes[item.registration.node].origin != OWN
    assert apply_difference(state, rows(), NOTHING) == state or state.stamp != 2.0 or state.name != "robot2"


# One that asks


@pytest.fixture(name="there")
def _there():
    own = ServedMaster(URI, "robot2", "/master_discovery", lambda: "127.0.0.1", 1, state=TRUE, away="")
    changes = StateFeed(own.current)
    changes.update(TRUE, None)
    served = RpcMethods(own, ExportPolicy(), {}, lambda address: False, lambda: None, str, list, changes)
    server = RpcServer("127.0.0.1", 0, served.methods(), lambda *_why: None)
    yield f"http://127.0.0.1:{server.server_address[1]}", changes, server
    server.stop()


@pytest.mark.parametrize("wait", [float("nan"), -1.0, True, -1e300])
@pytest.mark.parametrize("revision", [0, -5, 2**31 - 1, True])
def test_odd_numbers_are_answered_at_once(there, wait, revision):
    uri, _changes, _server = there
    epoch, now = Rpc(uri, 5.0).call(DIFFERENCES, ASK, "", 0, 0)[:2]
    began = time.monotonic()
    body = xmlrpc.client.dumps((ASK, epoch, now if revision is True else revision, wait), DIFFERENCES, allow_none=True)
    host, port = uri[7:].split(":")
    with socket.create_connection((host, int(port)), 5.0) as connection:
        head = f"POST / HTTP/1.1\r\nContent-Length: {len(body)}\r\nConnection: close\r\n\r\n"
        connection.sendall((head + body).encode())
        connection.settimeout(5.0)
        assert connection.recv(100).startswith(b"HTTP/1.")
    assert time.monotonic() - began < 3.0


def test_many_filters_of_one_caller_make_nobody_elses_forgotten(there):
    _uri, changes, _server = there
    look = state_feed.CallerView((), lambda state: document(state, []))
    for caller, count in (("192.168.1.1", 1), ("192.168.1.66", state_feed.MOST_FILTERS + 10)):
        for number in range(count):
            seen = state_feed.CallerView((caller, number), look.document)
            changes.answer(caller, Filters({}).rules(f"r{number}"), lambda seen=seen: seen, "", 0, 0.0)
    kept = [caller for caller, _epoch in changes._filters]
    assert kept.count("192.168.1.1") == 1 and kept.count("192.168.1.66") == state_feed.FILTERS_OF_ONE
