# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Which nodes are still there: asked of servers that answer as nodes do."""

import socket
import threading
import time

import pytest
from rosfleet_multimaster.core.registry import Registry
from rosfleet_multimaster.edge.loop import Loop, Workers
from rosfleet_multimaster.edge.rpc_server import RpcServer
from rosfleet_multimaster.parts import survivors as module
from rosfleet_multimaster.parts.survivors import Had, State


@pytest.fixture
def node():
    """Start a node that says that it has these topics; its URI."""
    servers = []

    def start(publishes=("/out", "/rosout"), subscribes=("/in",), more=()):
        methods = {
            "getPid": lambda _caller: [1, "", 7],
            "getPublications": lambda _caller: [1, "", [[topic, "x/Y"] for topic in publishes]],
            "getSubscriptions": lambda _caller: [1, "", [[topic, "x/Y"] for topic in subscribes]],
        }
        server = RpcServer("127.0.0.1", 0, {**methods, **dict(more)}, lambda _host, _why: None)
        servers.append(server)
        return "http://127.0.0.1:%d/" % server.server_address[1]

    yield start
    for server in servers:
        server.stop()


def had(publishes=("/out",), subscribes=("/in",), services=()):
    return Had({"publisher": set(publishes), "subscriber": set(subscribes)}, dict(services))


def test_a_node_that_has_what_it_had(node):
    assert module.ask("/a", node(), had()) == (State.ALIVE, [])


def test_a_node_that_has_less(node):
    uri = node()
    found = module.ask("/a", uri, had(["/out", "/gone"], ["/in", "/past"]))
    assert found == (State.ALIVE, [["publisher", "/gone", "/a", uri], ["subscriber", "/past", "/a", uri]])


def test_a_node_that_is_dead():
    assert module.ask("/a", "http://127.0.0.1:1/", had()).state is State.GONE


def test_another_node_at_the_same_port(node):
    assert module.ask("/a", node(["/other"], ["/others"]), had()).state is State.GONE


def test_another_program_at_the_same_port(node):
    assert module.ask("/a", node(more={"getPid": lambda _caller: 1 / 0}.items()), had()).state is State.GONE


def test_a_node_that_does_not_tell_its_topics_is_believed(node):
    silent = {"getPublications": lambda _caller: [-1, "", 0], "getSubscriptions": lambda _caller: 1 / 0}
    assert module.ask("/a", node(more=silent.items()), had()) == (State.ALIVE, [])


def test_a_node_with_parameters_only(node):
    assert module.ask("/a", node([], []), had([], [])).state is State.ALIVE


def test_a_node_that_says_nothing(monkeypatch):
    monkeypatch.setattr(module, "TIMEOUT", 0.2)
    with socket.create_server(("127.0.0.1", 0)) as listener:
        assert module.ask("/a", f"http://127.0.0.1:{listener.getsockname()[1]}/", had()).state is State.SILENT


@pytest.mark.parametrize("provided", ["/a", "/other", "", ConnectionRefusedError(), OSError("late")])
def test_a_service_is_asked_whose_it_is(node, monkeypatch, provided):
    def provider(_uri, _service, _timeout):
        if isinstance(provided, Exception):
            raise provided
        return provided

    monkeypatch.setattr(module, "provider", provider)
    uri = node()
    found = module.ask("/a", uri, had(services={"/stop": "rosrpc://robot:3"}.items()))
    stays = provided == "/a" or (isinstance(provided, OSError) and not isinstance(provided, ConnectionError))
    assert found == (State.ALIVE, [] if stays else [["service", "/stop", "/a", "rosrpc://robot:3"]])


def registry(**uris):
    found = Registry()
    for name, uri in uris.items():
        found.apply(["node", f"/{name}", uri])
        found.apply(["publisher", "/out", f"/{name}", uri, True])
    return found


def test_all_are_asked_and_a_silent_one_again(node, monkeypatch):
    monkeypatch.setattr(module, "TIMEOUT", 0.2)
    monkeypatch.setattr(module, "AGAIN", 0.2)
    loop, ended, removed = Loop(), [], []
    slow = socket.create_server(("127.0.0.1", 0))
    uris = {"alive": node(), "less": node(["/rosout"], []), "dead": "http://127.0.0.1:1/"}
    uris["slow"] = f"http://127.0.0.1:{slow.getsockname()[1]}/"
    found = registry(**uris)
    found.apply(["publisher", "/rosout", "/less", uris["less"], True])
    survivors = module.Survivors(
        Workers(loop, 4), lambda name, _uri: ended.append(name), lambda record: removed.append(record) or True
    )
    survivors.begin(found)
    threading.Timer(0.6, slow.close).start()
    until = time.monotonic() + 3.0
    loop.run(lambda now: (now > until or not survivors._left) and loop.stop() or now + 0.05)
    assert sorted(ended) == ["/dead", "/slow"] and removed == [["publisher", "/out", "/less", uris["less"]]]


def test_those_that_answer_within_a_time(node):
    with socket.create_server(("127.0.0.1", 0)) as listener:
        uris = {
            "alive": node(),
            "dead": "http://127.0.0.1:1/",
            "slow": f"http://127.0.0.1:{listener.getsockname()[1]}/",
        }
        assert module.alive_of(registry(**uris), 0.5) == {("/alive", uris["alive"])}
    assert module.alive_of(Registry(), 0.5) == set()
