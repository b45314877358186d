# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The nodes that are still there: asked of servers that answer as nodes do."""

import socket
import threading
import time

import pytest
from rosfleet_multimaster.edge import loop as loop_module
from rosfleet_multimaster.edge.clock import monotonic
from rosfleet_multimaster.edge.loop import Loop, Workers
from rosfleet_multimaster.edge.rpc_server import RpcServer
from rosfleet_multimaster.roscore import survivors as module
from rosfleet_multimaster.roscore.core.registry import Registry

from tests.unit.nodes.roscore.records import rec


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


def had(publishes=("/out",), subscribes=("/in",), services=(), uri="http://robot:1/"):
    """The records of the node /a."""
    kinds = (("publisher", publishes), ("subscriber", subscribes))
    topics = [rec(kind, topic, "/a", uri) for kind, names in kinds for topic in names]
    return topics + [rec("service", name, "/a", where, uri, True) for name, where in services]


def test_a_node_that_has_what_it_had(node):
    assert module.ask("/a", node(), had()) == []


def test_a_node_that_has_less(node):
    found = module.ask("/a", node(), had(["/out", "/gone"], ["/in", "/past"]))
    assert found == had(["/gone"], ["/past"])


def test_a_node_that_is_dead():
    assert module.ask("/a", "http://127.0.0.1:1/", had()) is None


def test_another_node_at_the_same_port(node):
    assert module.ask("/a", node(["/other"], ["/others"]), had()) is None


def test_another_program_at_the_same_port(node):
    assert module.ask("/a", node(more={"getPid": lambda _caller: 1 / 0}.items()), had()) is None


def test_a_node_that_does_not_tell_its_topics_is_believed(node):
    silent = {"getPublications": lambda _caller: [-1, "", 0], "getSubscriptions": lambda _caller: 1 / 0}
    assert module.ask("/a", node(more=silent.items()), had()) == []


def test_a_node_with_parameters_only(node):
    assert module.ask("/a", node([], []), had([], [])) == []


def test_a_node_that_says_nothing(monkeypatch):
    monkeypatch.setattr(module, "TIMEOUT", 0.2)
    with socket.create_server(("127.0.0.1", 0)) as listener, pytest.raises(OSError):
        module.ask("/a", f"http://127.0.0.1:{listener.getsockname()[1]}/", had())


@pytest.mark.parametrize("provided", ["/a", "/other", "", ConnectionRefusedError(), OSError("late")])
def test_a_service_is_asked_whose_it_is(node, monkeypatch, provided):
    def provider(_uri, _service, _timeout):
        if isinstance(provided, Exception):
            raise provided
        return provided

    monkeypatch.setattr(module, "provider", provider)
    service = [("/stop", "rosrpc://robot:3")]
    found = module.ask("/a", node(), had(services=service))
    stays = provided == "/a" or isinstance(provided, OSError)
    assert found == ([] if stays else had([], [], service))


def registry(**uris):
    found = Registry()
    for name, uri in uris.items():
        found.apply(rec("node", f"/{name}", uri))
        found.apply(rec("publisher", "/out", f"/{name}", uri, True))
    return found


class Roscore:
    """The roscore, which records the calls to it."""

    def __init__(self):
        self.ended, self.removed, self.back, self.buried, self.held = [], [], [], [], True

    def has(self, _name, _uri):
        return self.held

    def end_node(self, name, _uri):
        self.ended.append(name)

    def end_registration(self, record):
        self.removed.append(record)
        return True

    def has_ended(self, _name):
        return self.held

    def bury(self, name, _uri):
        self.buried.append(name)

    def readmit(self, registry):
        self.back.append(registry)


@pytest.fixture
def survey(monkeypatch):
    """Ask until a condition is true; what was done to the roscore."""
    monkeypatch.setattr(module, "TIMEOUT", 0.5)
    monkeypatch.setattr(module, "AGAIN", 0.2)

    def run(ask, over):
        loop, roscore = Loop(), Roscore()
        survivors = module.Survivors(Workers(loop, 4), roscore)
        ask(survivors)
        until = time.monotonic() + 30.0
        loop.run(lambda now: (now > until or over(survivors, roscore)) and loop.stop() or now + 0.05)
        return roscore

    return run


@pytest.mark.slow
def test_all_are_asked_and_a_silent_one_again(node, survey):
    slow = socket.create_server(("127.0.0.1", 0))
    uris = {"alive": node(), "less": node(["/rosout"], []), "dead": "http://127.0.0.1:1/"}
    uris["slow"] = f"http://127.0.0.1:{slow.getsockname()[1]}/"
    found = registry(**uris)
    found.apply(rec("publisher", "/rosout", "/less", uris["less"], True))
    threading.Timer(0.6, slow.close).start()
    done = survey(lambda survivors: survivors.begin(found), lambda survivors, _done: not survivors._silent)
    assert sorted(done.ended) == ["/dead", "/slow"] and done.removed == [
        rec("publisher", "/out", "/less", uris["less"], True)
    ]


@pytest.mark.slow
def test_a_silent_node_stays_as_long_as_it_is_registered(survey, caplog):
    asked = []
    with socket.create_server(("127.0.0.1", 0)) as slow:
        uri = f"http://127.0.0.1:{slow.getsockname()[1]}/"

        def over(survivors, roscore):
            asked.append(survivors.silent)
            roscore.held = len(asked) < 20  # then somebody else has its name, or `rosnode cleanup` was called
            return not survivors._silent

        done = survey(lambda survivors: survivors.begin(registry(slow=uri)), over)
    assert asked[20] == 1 and asked[-1] == 0 and done.ended == [] == done.removed
    assert sum("does not answer" in record.message for record in caplog.records) == 1


@pytest.mark.slow
def test_after_a_boot_a_node_comes_back_when_it_answers(node, survey, monkeypatch):
    monkeypatch.setattr(module, "provider", lambda uri, _service, _timeout: "/late" if uri.endswith(":1") else "/x")
    uris = {"dead": "http://127.0.0.1:1/", "late": node()}
    silences, ask = [OSError("late")] * 2, module.ask

    def ask_late(name, *of):
        if "late" in name and silences:
            raise silences.pop()
        return ask(name, *of)

    monkeypatch.setattr(module, "ask", ask_late)
    found = registry(**uris)
    found.apply(rec("publisher", "/gone", "/late", uris["late"], True))
    found.apply(rec("listener", "/speed", "/late", uris["late"], True))
    for number in (1, 2):
        found.apply(rec("service", f"/serve_{number}", "/late", f"rosrpc://robot:{number}", uris["late"], True))
    done = survey(lambda survivors: survivors.wait_for(found), lambda _survivors, roscore: roscore.back)
    (back,) = done.back
    assert back.values("node") == {"/late": uris["late"]}
    left = [record[:2] for record in back.facts.values() if record[0] != "node"]
    assert left == [("publisher", "/out"), ("listener", "/speed"), ("service", "/serve_1")]
    assert done.ended == [] == done.removed


def test_those_that_answer_within_a_time(node, monkeypatch):
    answers = []

    class Counted(Workers):
        def submit(self, job, done):
            super().submit(job, lambda *answer: (done(*answer), answers.append(answer)))

    with socket.create_server(("127.0.0.1", 0)) as listener:
        slow = f"http://127.0.0.1:{listener.getsockname()[1]}/"
        assert module.find_alive(registry(slow=slow), 0.5) == set()
        # The time is over as soon as two have answered, however long a busy machine takes for that.
        monkeypatch.setattr(module, "Workers", Counted)
        monkeypatch.setattr(module, "TIMEOUT", 60.0)
        monkeypatch.setattr(loop_module, "monotonic", lambda: monotonic() + (60.0 if len(answers) == 2 else 0.0))
        uris = {"alive": node(), "dead": "http://127.0.0.1:1/", "slow": slow}
        assert module.find_alive(registry(**uris), 30.0) == {("/alive", uris["alive"])}
    assert module.find_alive(Registry(), 0.5) == set()


@pytest.mark.slow
def test_a_node_with_nothing_left_is_asked_until_it_is_dead(node, survey):
    with socket.create_server(("127.0.0.1", 0)) as slow:
        uris = {"/alive": node([], []), "/dead": "http://127.0.0.1:1/"}
        uris["/slow"] = f"http://127.0.0.1:{slow.getsockname()[1]}/"

        def ask(survivors):
            for name, uri in [*uris.items(), *uris.items()]:  # twice, as when it withdraws two things
                survivors.look_after(name, uri)

        threading.Timer(1.5, slow.close).start()
        done = survey(ask, lambda survivors, _roscore: len(survivors._leaving) == 1)
        assert sorted(done.buried) == ["/dead", "/slow"] and done.ended == []


def test_a_node_that_has_something_again_is_asked_no_more(node, survey):
    def over(survivors, roscore):
        roscore.held = False
        return not survivors._leaving

    done = survey(lambda survivors: survivors.look_after("/alive", node()), over)
    assert done.buried == []


def test_nodes_that_are_asked_again_take_no_threads(survey, monkeypatch):
    """The network is down: each of them fails at once. The unit of the roscore may have 2,048 tasks."""
    asked = []

    def fail(name, _uri, _records):
        asked.append(name)
        raise OSError("network is unreachable")

    monkeypatch.setattr(module, "ask", fail)
    before, names = threading.active_count(), [f"n{number}" for number in range(500)]

    def begin(survivors):
        survivors.begin(registry(**dict.fromkeys(names, "http://far:1/")))
        for name in names:
            survivors.look_after(f"/left_{name}", "http://far:1/")
        assert threading.active_count() - before <= 4  # the workers

    def over(_survivors, _roscore):
        assert threading.active_count() - before <= 4
        return len(asked) > 3 * len(names)

    survey(begin, over)
    assert len(set(asked)) == 2 * len(names)
