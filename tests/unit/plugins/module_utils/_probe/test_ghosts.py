# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Registrations that killed talkers and listeners leave in a roscore, over real sockets."""

import socket

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._client import node
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe import ghosts
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
