# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Other relays that answer as they like. Sockets on 127.0.0.1."""

import contextlib
import threading
import time

import pytest
from rosfleet_multimaster.edge.patience import BURST, EARLY, RATE
from rosfleet_multimaster.edge.rpc_server import RefusedCall
from rosfleet_multimaster.relay import peers

from tests.unit.nodes.running_sync import serve

OFFERS = [["topic", "/kobuki1/scan", "sensor_msgs/LaserScan", ["/laser"]]]


class Over(BaseException):
    """The test is over. The thread of a peer lives as long as its program else."""


class Relay:
    """A relay that answers at once, with what `answer(number of the question)` says."""

    def __init__(self, answer):
        self.asked, self.ended, self._answer = 0, False, answer
        self.server, _uri = serve({peers.OFFERS: self._tell})
        self.port = self.server.server_address[1]

    def _tell(self, _robot, _revision, _wait):
        if self.ended:
            raise RefusedCall("the test is over")
        self.asked += 1
        return self._answer(self.asked)


@pytest.fixture(name="follow")
def _follow(monkeypatch):
    relays, threads, over = [], [], threading.Event()

    def sleep(seconds):
        if over.wait(seconds):
            raise Over

    def start_thread(_name, job):
        def work():
            with contextlib.suppress(Over):
                job()

        threads.append(threading.Thread(target=work))
        threads[-1].start()

    monkeypatch.setattr(peers, "sleep", sleep)
    monkeypatch.setattr(peers, "start_thread", start_thread)

    def follow(answer):
        relay, told = Relay(answer), []
        relays.append(relay)
        peer = peers.RelayPeer("kobuki1", ["127.0.0.1"], relay.port, "station")
        peer.start(lambda _robot, offers, why: told.append(why or offers))
        return relay, told

    yield follow
    over.set()
    for relay in relays:
        relay.ended = True
    for thread in threads:
        thread.join(10)
        assert not thread.is_alive()
    for relay in relays:
        relay.server.stop()


@pytest.mark.slow
@pytest.mark.parametrize("news", [True, False])
def test_however_fast_a_relay_answers_it_is_asked_at_the_pace(follow, news):
    began = time.monotonic()
    relay, told = follow(lambda number: [f"r{number if news else 0}", 5000, OFFERS])
    time.sleep(2.0)
    heard = len(told)  # first: what is told was asked before
    asked, took = relay.asked, time.monotonic() - began
    assert 2 <= asked <= (BURST + RATE * took + 2 if news else 2 + took / EARLY)
    assert heard <= asked if news else heard == 1


@pytest.mark.parametrize("wrong", [None, 7, [], ["r", "x", []], [1, 2, []], ["r", 5000, [["node", "/a", "", []]]]])
def test_a_wrong_answer_is_asked_again_and_told_of_nobody(follow, wrong):
    """The right one after it counts."""
    relay, told = follow(lambda number: wrong if wrong is not None and number == 1 else ["r", 5000, OFFERS])
    deadline = time.monotonic() + 10
    while not told:
        assert time.monotonic() < deadline
        time.sleep(0.02)
    assert told[0].port == 5000 and [offer.name for offer in told[0].entries] == ["/kobuki1/scan"]
    assert relay.asked >= (1 if wrong is None else 2)
