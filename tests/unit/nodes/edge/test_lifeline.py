# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""A lifeline: it tells the end of the other side, once."""

import socket

import pytest
from rosfleet_multimaster.edge.lifeline import Lifeline, lifeline
from rosfleet_multimaster.edge.loop import Loop


@pytest.mark.parametrize("farewell", [b"", b"HTTP/1.1 400 Bad request\r\n"])
def test_the_end_of_the_other_side_is_told_in_the_loop(farewell):
    loop, ends = Loop(), []
    line = Lifeline(loop, lambda: (ends.append(bool(line)), loop.stop()))
    with socket.create_server(("127.0.0.1", 0)) as server:
        uri = f"http://127.0.0.1:{server.getsockname()[1]}/"
        line.hold(uri, lifeline(uri))
        other, _address = server.accept()
        assert line and line.uri == uri
        loop.post(lambda: (other.sendall(farewell), other.close()))
        loop.run(lambda now: now + 5.0)
    assert ends == [False] and not line and not line.uri


def test_one_that_is_dropped_or_replaced_says_nothing():
    loop, ends = Loop(), []
    line = Lifeline(loop, lambda: ends.append(1))
    with socket.create_server(("127.0.0.1", 0)) as server:
        uri = f"http://127.0.0.1:{server.getsockname()[1]}/"
        line.hold(uri, lifeline(uri))
        line.hold(uri, lifeline(uri))
        line.drop()
        loop.post(loop.stop)
        loop.run(lambda now: now + 5.0)
    assert not ends and not line


@pytest.mark.parametrize("uri", ["", "x", "http://127.0.0.1:1/", "http://a b:99999/", "http://[/"])
def test_where_nobody_is_there_is_none(uri):
    assert lifeline(uri) is None
