# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Registrations that killed talkers and listeners leave in a roscore, over real sockets."""

import socket
import time

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._contract.outcomes import Outcome
from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine.outcomes import PortAnswer
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe import ghosts
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.ros_client import node
from talking import Roscore, served, talking, until

TOPIC = "/multimaster_verify/a"
TALKER, LISTENER = "/multimaster_verify_talker_a_abcdefghij", "/multimaster_verify_listener_a_12_345"


@pytest.fixture
def closed():
    """The URI of a port where nobody listens."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    return f"http://127.0.0.1:{port}/"


@pytest.fixture
def master(ros):
    roscore = Roscore()
    with served(roscore) as ros[0].uri:
        yield ros[0], roscore


def test_killed_nodes_of_this_computer_are_taken_out(master, closed):
    made, roscore = master
    roscore.registerPublisher(TALKER, TOPIC, node.TYPE, closed)
    for topic in (TOPIC, "/multimaster_verify/b"):
        roscore.registerSubscriber(LISTENER, topic, node.TYPE, closed)
    assert ghosts.end_ghosts(made, "a") == [LISTENER, TALKER]
    assert not any(nodes for table in (roscore.publishers, roscore.subscribers) for nodes in table.values())


@pytest.mark.parametrize(
    "name",
    [
        "/talker",
        "/multimaster_verify_talker_b_abcdefghij",
        "/multimaster_verify_talker_a_b_abcdefghij",
        "/multimaster_verify_listener_a_b_12_345",
        "/multimaster_verify_listener_a_12_345_more",
        "/x/multimaster_verify_listener_a_12_345",
    ],
)
def test_the_nodes_of_others_stay_whatever_became_of_them(master, closed, name):
    made, roscore = master
    roscore.registerPublisher(name, TOPIC, node.TYPE, closed)
    assert ghosts.end_ghosts(made, "a") == [] and roscore.of(TOPIC) == [closed]


def test_a_talker_that_lives_stays_and_a_killed_one_goes(master):
    made, roscore = master
    with talking(made.uri, TALKER, TOPIC, "x") as process:
        until(lambda: roscore.of(TOPIC))
        assert ghosts.end_ghosts(made, "a") == [] and roscore.of(TOPIC)
        process.kill()
        process.wait(10)
        assert ghosts.end_ghosts(made, "a") == [TALKER] and not roscore.of(TOPIC)


def test_without_a_roscore_nothing_is_done(ros, closed):
    ros[0].uri = closed
    assert ghosts.end_ghosts(ros[0], "a") == []


def test_uris_that_lead_nowhere_are_tried_at_the_same_time(master, closed, monkeypatch):
    """Any caller of the roscore can register them, each costs a connection that nobody answers."""
    made, roscore = master
    tried = []

    def wait(address, port, patience):
        tried.append(address)
        time.sleep(0.2)
        return PortAnswer(Outcome.REFUSED if address == "127.0.0.1" else Outcome.NO_ANSWER, None, None, "")

    monkeypatch.setattr(ghosts, "connect", wait)
    for number in range(300):
        name = f"/multimaster_verify_talker_a_x{number:03}"
        roscore.registerPublisher(name, f"{TOPIC}/{number}", node.TYPE, f"http://10.255.0.{number % 250}:1/")
    roscore.registerPublisher(TALKER, TOPIC, node.TYPE, closed)
    began = time.monotonic()
    assert ghosts.end_ghosts(made, "a") == [TALKER]
    assert len(tried) == ghosts.MOST and time.monotonic() - began < 0.2 * ghosts.MOST / 2


def test_what_never_answers_ends_at_the_limit(master, closed, monkeypatch):
    made, roscore = master
    monkeypatch.setattr(ghosts, "LONGEST", 0.5)
    monkeypatch.setattr(ghosts, "connect", lambda *_unused: time.sleep(5))
    roscore.registerPublisher(TALKER, TOPIC, node.TYPE, closed)
    began = time.monotonic()
    assert ghosts.end_ghosts(made, "a") == [] and time.monotonic() - began < 4


@pytest.mark.parametrize("uri", ["http://[x/", "http://x:99999/"])
def test_a_uri_that_is_none_hides_no_ghost(master, closed, uri):
    made, roscore = master
    roscore.registerPublisher(TALKER, TOPIC, node.TYPE, closed)
    roscore.registerPublisher(f"{TALKER}a", f"{TOPIC}b", node.TYPE, uri)
    assert ghosts.end_ghosts(made, "a") == [TALKER] and roscore.of(TOPIC) == []
