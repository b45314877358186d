# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The topics of talkers, heard by one node."""

import socket
import threading
import time

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._base import deadlines
from ansible_collections.rosfleet.multimaster.plugins.module_utils._contract.outcomes import Outcome
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.measure import topics
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.ros_client import tcpros, xml_rpc
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.ros_client.listener import TopicListener
from talking import Roscore, served, talking, until

TOPIC = "/multimaster_verify/kobuki2computer"


class Content(TopicListener):
    """It listens until a talker was heard, or could not be, however long a busy machine takes for that."""

    def run(self, deadline):
        def end():
            until(lambda: self.heard or self.errors)
            self._done.set()

        ending = threading.Thread(target=end)
        ending.start()
        super().run(deadline)
        ending.join(20)


@pytest.fixture
def made(ros, monkeypatch):
    found, command = ros
    command("rostopic", "exit 1\n")  # there is ROS
    found.variables["ROS_IP"] = "127.0.0.1"
    monkeypatch.setattr(topics, "LEAST", 20.0)
    monkeypatch.setattr(topics, "TopicListener", Content)
    return found


def heard_by(made, text, talkers):
    roscore = Roscore()
    with served(roscore) as made.uri, talking(made.uri, "/talker", TOPIC, text):
        until(lambda: roscore.of(TOPIC))
        return topics.topics(made, talkers, "run", "kobuki1computer", 0), roscore.publishers[TOPIC]["/talker"]


def test_one_node_listens_to_all_talkers(made):
    (heard, silent), uri = heard_by(made, "run kobuki2computer", ["kobuki2computer", "kobuki3computer"])
    assert (heard["heard"], heard["text"], heard["error"]) == (True, "run kobuki2computer", "")
    assert heard["seconds"] < 10 and heard["publishers"] == [{"node": "/talker", "uri": uri}]
    assert not silent["heard"] and silent["publishers"] == [] and "not registered" in silent["error"]


class Publisher:
    """A publisher that says where its topic is to be had, and is silent there or has ended."""

    def __init__(self, port):
        self.port = port

    def requestTopic(self, caller, topic, protocols):
        return 1, "", ["TCPROS", "127.0.0.1", self.port]


@pytest.mark.parametrize(("listens", "step"), [(True, "connected"), (False, "answered")])
def test_the_step_of_a_call_is_told(made, monkeypatch, listens, step):
    monkeypatch.setattr(tcpros, "CALL", 0.3)
    with socket.socket() as data:
        data.bind(("127.0.0.1", 0))
        if listens:
            data.listen()
        roscore = Roscore()
        with served(roscore) as made.uri, served(Publisher(data.getsockname()[1])) as uri:
            roscore.publishers[TOPIC] = {"/talker": uri}
            (entry,) = topics.topics(made, ["kobuki2computer"], "run", "kobuki1computer", 0)
    assert (entry["heard"], entry["step"], entry["reached"]) == (False, step, "open")


def test_a_publisher_that_says_nothing_was_only_told(made, monkeypatch):
    monkeypatch.setattr(xml_rpc, "CALL", 1.0)
    with socket.socket() as silent:
        silent.bind(("127.0.0.1", 0))
        silent.listen()
        roscore = Roscore()
        with served(roscore) as made.uri:
            roscore.publishers[TOPIC] = {"/talker": f"http://127.0.0.1:{silent.getsockname()[1]}/"}
            told, untold = topics.topics(made, ["kobuki2computer", "kobuki3computer"], "run", "kobuki1computer", 0)
    assert (told["step"], told["reached"], untold["step"]) == ("told", "open", "")
    assert f"no whole answer within {xml_rpc.CALL:g} s" in told["error"] or "timed out" in told["error"]


def test_an_older_talker_is_not_taken_for_this_run(made):
    (entry,), _uri = heard_by(made, "yesterday kobuki2computer", ["kobuki2computer"])
    assert not entry["heard"] and "yesterday" in entry["error"]


def test_a_listener_that_fails_says_why(made):
    made.uri = "http://127.0.0.1:9"
    (entry,) = topics.topics(made, ["kobuki2computer"], "run", "kobuki1computer", 0)
    assert not entry["heard"] and "http://127.0.0.1:9" in entry["error"]


def test_nobody_subscribes_at_a_roscore_that_does_not_answer(made, monkeypatch):
    monkeypatch.setattr(topics, "listen", lambda *_about: pytest.fail("it listens"))
    made.uri = "http://127.0.0.1:9"
    (entry,) = topics.topics(made, ["kobuki2computer"], "run", "kobuki1computer", 0)
    assert not entry["listened"] and not entry["step"]


def _published(uri):
    return {"publishers": [{"node": "/talker", "uri": uri}]}


def test_a_publisher_that_was_not_heard_is_reached_or_not():
    with socket.socket() as there:
        there.bind(("127.0.0.1", 0))
        uri = f"http://127.0.0.1:{there.getsockname()[1]}/"
        assert topics._reach(_published(uri)) == (Outcome.REFUSED, "Connection refused")
        there.listen()
        assert topics._reach(_published(uri)) == (Outcome.OPEN, "open")


@pytest.mark.parametrize(
    "uri", ["", "http://127.0.0.1:99999999/", "http://[::1/", "http://x.invalid:1/", "http://x..y:1/"]
)
def test_a_uri_that_is_none_is_not_reached(uri):
    assert topics._reach(_published(uri))[0] != Outcome.OPEN


def test_a_registration_that_is_away_for_a_moment_is_waited_for(monkeypatch):
    """Seen beside upstream's nodes, with publishers that were heard."""
    monkeypatch.setattr(deadlines, "PAUSE", 0.0)
    answers = [OSError("unknown node"), OSError("unknown node"), "http://b:40000/"]

    class Forgetful:
        def ask(self, method, node):
            answer = answers.pop(0)
            if isinstance(answer, OSError):
                raise answer
            return answer

    assert topics._uri(Forgetful(), "/talker", time.monotonic() + 5) == "http://b:40000/"
    answers[:] = [OSError("unknown node"), "http://b:40000/"]
    assert topics._uri(Forgetful(), "/talker", 0.0) == ""
