# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Calls with real sockets, in a loop of their own: bytes both ways, silent ones, and those that hold much."""

import socket
import threading

import pytest
from rosfleet_multimaster.edge.loop import Loop
from rosfleet_multimaster.relay import calls
from rosfleet_multimaster.relay.account import Accounts

ROBOTS = ("own", "bad", "good")


class Running:
    """The calls of a relay."""

    def __init__(self):
        self.loop = Loop()
        self.accounts = Accounts(self.loop, ROBOTS, "own")
        self.calls = calls.Calls(self.loop, [f"of {robot}" for robot in ROBOTS])
        self.thread = threading.Thread(target=self.loop.run, args=(lambda now: now + 60,))
        self.thread.start()

    def do(self, deed):
        done, results = threading.Event(), []
        self.loop.post(lambda: (results.append(deed()), done.set()))
        assert done.wait(10)
        return results[0]

    def begin(self, robot="bad", first=b""):
        """A call: its record, the client and the provider."""
        (client, one), (provider, other) = socket.socketpair(), socket.socketpair()
        account = self.accounts.find(robot)

        def start():
            call = self.calls.begin(account, f"of {robot}", one, first)
            if call is not None:
                call.start(other)
            return call

        for end in (client, provider):
            end.settimeout(10)
        return self.do(start), client, provider


@pytest.fixture
def running(monkeypatch):
    # A socket of this kind has no options of TCP.
    monkeypatch.setattr(calls, "keep_alive", lambda _connection: None)
    made = Running()
    yield made
    made.loop.stop()
    made.thread.join(5)


def read(connection, size):
    data = b""
    while len(data) < size:
        piece = connection.recv(size - len(data))
        if not piece:
            break
        data += piece
    return data


def test_bytes_go_both_ways_in_their_order(running):
    call, client, provider = running.begin(first=b"header")
    large = bytes(range(256)) * 8000  # more than the kernel holds
    for one, other, before in ((client, provider, b"header"), (provider, client, b"")):
        sender = threading.Thread(target=one.sendall, args=(large,))
        sender.start()
        assert read(other, len(before) + len(large)) == before + large
        sender.join()
    client.close()
    assert provider.recv(1) == b"" and running.do(lambda: call.ended)


def test_the_call_that_is_silent_longest_ends_for_a_new_one(running):
    made = [running.begin() for _number in range(calls.MOST_OF_ONE)]
    assert running.begin()[0] is None, "all of them have begun a short while ago"
    made[7][0].heard -= calls.SILENT + 1
    made[9][0].heard -= calls.SILENT + 2
    assert running.begin()[0] is not None
    assert made[9][1].recv(1) == b"" and made[9][0].ended and not made[7][0].ended
    assert running.begin("good")[0] is not None, "and others have their own"


def test_a_call_that_is_silent_for_very_long_ends(running):
    (call, client, _provider), (other, _client, _end) = running.begin(), running.begin()
    running.do(lambda: running.calls.tick(other.heard + calls.IDLE - 1))
    assert not call.ended
    running.do(lambda: running.calls.tick(call.heard + calls.IDLE + 1))
    assert call.ended and client.recv(1) == b""


def test_what_calls_hold_is_given_back(running):
    budget = running.accounts.budget
    for _number in range(3):
        made = [running.begin(first=bytes(20_000)) for _number in range(20)]
        assert all(call is not None for call, _client, _provider in made)
        assert budget._kept.count("bad") == 20 * (20_000 + 2 * calls.PIECE)
        for call, _client, _provider in made:
            running.do(call.end)
        assert budget._kept.count("bad") == 0
    budget.keep("bad", 8 << 20)
    assert running.begin()[0] is None, "no memory is left"
