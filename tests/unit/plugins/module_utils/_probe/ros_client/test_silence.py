# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""A roscore that gives no answer, as one that hangs, or that a packet filter hides: the parts of a look wait for it once."""

import socket
import threading

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._contract.outcomes import Outcome
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.measure import (
    exchange,
    masters,
    parameters,
    sources,
    topics,
)
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.ros_client import (
    node_services,
    silence,
    xml_rpc,
)
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.ros_client import ros as probe_ros
from talking import Roscore, served, until

PLANNED = {"master_discovery": {"rpc_port": 11611}, "master_sync": {"sync_hosts": []}}


class Hung:
    """A roscore that takes connections and never answers; it counts them."""

    def __init__(self):
        self.door = socket.create_server(("127.0.0.1", 0))
        self.uri = f"http://127.0.0.1:{self.door.getsockname()[1]}"
        self.taken = []
        self._thread = threading.Thread(target=self._take)
        self._thread.start()

    def _take(self):
        try:
            while True:
                self.taken.append(self.door.accept()[0])
        except OSError:
            pass

    def end(self):
        self.door.shutdown(socket.SHUT_RDWR)
        self._thread.join()
        for each in (self.door, *self.taken):
            each.close()


@pytest.fixture
def hung():
    roscore = Hung()
    yield roscore
    roscore.end()


@pytest.fixture
def made(ros, monkeypatch):
    monkeypatch.setattr(xml_rpc, "CALL", 0.2)
    monkeypatch.setattr(silence, "LONGEST", 0.3)
    found, command = ros
    command("rostopic", "exit 1\n")  # there is ROS
    return found


def silent(made, uri):
    """Ask a roscore until its silence is a long one."""
    made.uri = uri
    for _number in range(2):
        assert probe_ros.roscore(made, 0)["outcome"] == Outcome.NO_ANSWER.value


@pytest.mark.parametrize(
    ("asked", "look"),
    [
        (1, lambda ros: topics.topics(ros, ["b"], "run", "a", 0)),  # it may have started by now
        (0, lambda ros: sources.sources(ros, [], {}, "a", ["b"], 0)),
        (0, lambda ros: exchange.exchange(ros, [], "a")),
        (0, lambda ros: parameters.parameters(ros, PLANNED, ["/speed"])),
        (0, lambda ros: masters._ask_types(ros, "/node", float("inf"))),
    ],
    ids=["topics", "sources", "exchange", "parameters", "types"],
)
def test_no_part_waits_again_for_a_roscore_that_was_silent_for_long(made, hung, monkeypatch, asked, look):
    monkeypatch.setattr(topics, "PAUSE", 0.0)
    silent(made, hung.uri)
    until(lambda: len(hung.taken) == 4)  # two questions, and a mere connection after each
    look(made)
    until(lambda: len(hung.taken) >= 4 + asked)
    assert len(hung.taken) == 4 + asked


def test_a_roscore_that_falls_silent_is_not_asked_for_the_other_services(made, hung):
    names = [f"/{name}/list_masters" for name in "abcdefgh"]
    assert node_services.find_own(hung.uri, "/me", names, node_services.LIST_MASTERS) == names
    until(lambda: hung.taken)
    assert len(hung.taken) == 1


def test_what_others_are_told_is_what_the_last_question_met(made, hung):
    silent(made, hung.uri)
    with pytest.raises(OSError, match="no whole answer within 0.2 s") as told:
        made.read_state()
    assert isinstance(told.value.__cause__, socket.timeout)


def test_a_roscore_that_answers_at_last_is_asked_by_all(made, hung):
    silent(made, hung.uri)
    with served(Roscore()) as made.uri:
        assert not probe_ros.roscore(made, 0)["error"]
        assert topics.read_publishers(made) == {}


def test_a_late_answer_among_others_is_no_silence(made, monkeypatch):
    """Lost packets make one question late, while the roscore answers others."""
    monkeypatch.setattr(silence, "LONGEST", 0.0)
    found = silence.Silence()

    def late():
        found.ask(lambda: "answer", False)
        raise OSError("late") from TimeoutError()

    with pytest.raises(OSError, match="late"):
        found.ask(late, False)
    assert found.ask(lambda: "answer", False) == "answer"


def test_a_roscore_that_refuses_is_not_silent(made, monkeypatch):
    monkeypatch.setattr(silence, "LONGEST", 0.0)
    made.uri = "http://127.0.0.1:9"
    assert probe_ros.roscore(made, 0)["outcome"] == Outcome.REFUSED.value
    with served(Roscore()) as made.uri:
        assert topics.read_publishers(made) == {}
