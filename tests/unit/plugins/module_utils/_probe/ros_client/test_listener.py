# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The listener, over real sockets: talkers that are there, that come later, that are older ones, and that are none."""

import contextlib
import threading
import time

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.ros_client.listener import TopicListener
from talking import Roscore, served, talking, until

ONE, TWO = "/multimaster_verify/one", "/multimaster_verify/two"


@pytest.fixture
def master():
    roscore = Roscore()
    with served(roscore) as uri:
        yield roscore, uri


@pytest.fixture
def made(ros, master):
    found = ros[0]
    found.uri = master[1]
    found.variables["ROS_IP"] = "127.0.0.1"
    return found


@pytest.mark.slow
def test_a_talker_is_heard_also_one_that_comes_later(made, master):
    roscore, uri = master
    listener = TopicListener(made, "listener", {ONE: "run one", TWO: "run two"})
    thread = threading.Thread(target=listener.run, args=(time.monotonic() + 30,))
    with talking(uri, "/talker_one", ONE, "run one"):
        until(lambda: roscore.of(ONE))
        thread.start()
        until(lambda: ONE in listener.heard and roscore.subscribers.get(TWO))
        with talking(uri, "/talker_two", TWO, "run two"):
            thread.join(20)
    assert not thread.is_alive() and roscore.subscribers == {ONE: {}, TWO: {}}
    assert {topic: (said["text"], said["node"]) for topic, said in listener.heard.items()} == {
        ONE: ("run one", "/talker_one"),
        TWO: ("run two", "/talker_two"),
    }


@contextlib.contextmanager
def listening(listener):
    """It listens until the test has seen what it is about."""
    thread = threading.Thread(target=listener.run, args=(time.monotonic() + 20,))
    thread.start()
    try:
        yield
    finally:
        listener._done.set()
        thread.join(20)
    assert not thread.is_alive()


@pytest.mark.slow
def test_an_older_talker_does_not_count_and_a_newer_one_does(made, master):
    roscore, uri = master
    with talking(uri, "/older", ONE, "yesterday one"):
        until(lambda: roscore.of(ONE))
        listener = TopicListener(made, "listener", {ONE: "run one"})
        with listening(listener):
            until(lambda: ONE in listener.heard)
        assert listener.heard[ONE]["text"] == "yesterday one"
        with talking(uri, "/newer", ONE, "run one"):
            until(lambda: len(roscore.of(ONE)) == 2)
            listener = TopicListener(made, "listener", {ONE: "run one"})
            listener.run(time.monotonic() + 20)
            assert listener.heard[ONE]["node"] == "/newer"


def test_who_does_not_answer_is_asked_again_and_named(made, master):
    roscore, uri = master
    roscore.publishers[ONE] = {"/gone": "http://127.0.0.1:9/"}
    listener = TopicListener(made, "listener", {ONE: "run one"})
    with listening(listener):
        until(lambda: ONE in listener.errors)
    assert (listener.heard, listener.errors[ONE]) == ({}, 'http://127.0.0.1:9/: "Connection refused"')


def test_a_crowd_that_does_not_answer_takes_no_thread_each(made, master):
    roscore, uri = master
    roscore.publishers[ONE] = {f"/gone{port}": f"http://127.0.0.1:{port}/" for port in range(1, 800)}
    listener = TopicListener(made, "listener", {ONE: "run one"})
    before = threading.active_count()
    with listening(listener):
        until(lambda: ONE in listener.errors)
        most = 0
        for _look in range(20):
            most = max(most, threading.active_count() - before)
            time.sleep(0.05)
    assert most < 20


def test_new_publishers_wait_behind_those_that_are_due(made, master):
    """Anybody may name new ones all the time: the one that is asked again would have no turn."""
    listener = TopicListener(made, "listener", {ONE: "run one", TWO: "run two"})
    listener._due.put((time.monotonic(), TWO, "http://127.0.0.1:9/"))
    listener._on_publishers(ONE, [f"http://127.0.0.1:{port}/" for port in range(1, 9)])
    assert listener._due.get_nowait()[1] == TWO
    listener.node.ended = True
    listener.node.serve()


@pytest.mark.parametrize("publishers", ["text", 7, [7, None], {"a": 1}])
def test_a_strange_list_of_publishers_is_nobody(made, master, publishers):
    listener = TopicListener(made, "listener", {ONE: "run one"})
    listener._on_publishers(ONE, publishers)
    listener._on_publishers("/other", ["http://127.0.0.1:9/"])
    assert listener._due.empty()
    listener.node.ended = True
    listener.node.serve()


def test_without_a_roscore_it_says_so(made, master):
    made.uri = "http://127.0.0.1:9"
    with pytest.raises(OSError, match="http://127.0.0.1:9: "):
        TopicListener(made, "listener", {ONE: "run one"}).run(time.monotonic() + 5)


class Busy(Roscore):
    """It carries out the first registration, and the first withdrawal not, and answers neither in time."""

    def __init__(self):
        super().__init__()
        self.calls = []

    def registerSubscriber(self, caller, topic, kind, uri):
        super().registerSubscriber(caller, topic, kind, uri)
        self.calls.append("register")
        raise OSError("too late")

    def unregisterSubscriber(self, caller, topic, uri):
        self.calls.append("unregister")
        if self.calls.count("unregister") == 1:
            raise OSError("too late")
        return super().unregisterSubscriber(caller, topic, uri)


def test_a_busy_roscore_keeps_no_registration(made):
    roscore = Busy()
    with served(roscore) as made.uri, pytest.raises(OSError, match="too late"):
        TopicListener(made, "listener", {ONE: "run one", TWO: "run two"}).run(time.monotonic() + 5)
    assert roscore.calls == ["register", "unregister", "unregister"]
    assert roscore.subscribers == {ONE: {}}


def test_a_roscore_that_has_ended_is_not_asked_again(made):
    with served(Roscore()) as made.uri:
        listener = TopicListener(made, "listener", {ONE: "run one"})
    began = time.monotonic()
    listener._leave([ONE, TWO], began + 30)
    assert time.monotonic() - began < 5
    listener.node.ended = True
    listener.node.serve()
