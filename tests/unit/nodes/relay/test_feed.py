# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Feeds with real sockets: publishers that are there or not, late, latched or hostile, and listeners that do not read."""

import contextlib
import socket
import struct
import threading
import time

import pytest
from mentioned import mentions
from rosfleet_multimaster.edge.clock import monotonic, processor_time
from rosfleet_multimaster.edge.loop import Loop
from rosfleet_multimaster.edge.process.program import LimitedLog
from rosfleet_multimaster.protocol.tcpros.header import encode_header
from rosfleet_multimaster.relay.account import Accounts
from rosfleet_multimaster.relay.core.rates import Rate
from rosfleet_multimaster.relay.dial import Dialers
from rosfleet_multimaster.relay.feed import Origin, TopicFeed
from rosfleet_multimaster.relay.wire import MAX_HEADER, Wire

from tests.unit.nodes.relay.ends import DEAR, DEEP, SUM, End, Publisher, free_port, message

ROBOTS = ("own", "talker", "listener")


class Running:
    """A feed in a loop of its own."""

    def __init__(self, of_one=False):
        self.loop, self.due = Loop(), 0.0
        self.change = None  # of the frames
        self.accounts = Accounts(self.loop, ROBOTS, "own")
        dialers = Dialers(self.loop, "own", ROBOTS)
        self.feed = TopicFeed(self.loop, dialers, LimitedLog(), self.accounts.budget, "/chatter", self.request, of_one)
        self.thread = threading.Thread(target=self.loop.run, args=(self.turn,))
        self.thread.start()

    def request(self, due):
        self.due = min(self.due, due)

    def turn(self, now):
        """One turn of the loop; a test may put another tick in its place."""
        return self.tick(now)

    def tick(self, now):
        if now >= self.due:
            self.due = now + 60
            self.feed.tick(now)
        return self.due

    def do(self, deed):
        done, results = threading.Event(), []
        self.loop.post(lambda: (results.append(deed()), done.set()))
        assert done.wait(10)
        return results[0]

    def aim(self, *publishers):
        question = {"callerid": "/relay", "topic": "/chatter", "md5sum": "*"}
        sources = {
            number: Origin(one.dial, f"http://talker:{number}/", question, self.accounts.find("talker"), self.change)
            for number, one in enumerate(publishers)
        }
        self.do(lambda: self.feed.aim(sources))

    def listen(self, rate=0.0, newest=False, **asked):
        """A listener: its end, after its header was sent."""
        ours, theirs = _connect()

        def add():
            def greet(wire):
                if newest:
                    wire.keep_newest()
                self.feed.add(wire, {"callerid": "/relay", "topic": "/k/chatter"}, Rate(rate))

            Wire(
                self.loop,
                ours,
                self.accounts.find("listener"),
                greet,
                None,
                lambda wire, why: self.feed.remove(wire),
            )

        self.do(add)
        end = End(theirs)
        end.say(encode_header({"callerid": "/listener", "topic": "/k/chatter", "md5sum": "*", **asked}))
        return end

    def stop(self):
        self.do(self.feed.end)
        self.loop.stop()
        self.thread.join(5)
        assert not self.thread.is_alive()


def _connect():
    with socket.create_server(("127.0.0.1", 0)) as server:
        one = socket.create_connection(server.getsockname())
        return server.accept()[0], one


@pytest.fixture
def running():
    made = Running()
    yield made
    made.stop()


def wait_for(condition, seconds=10.0):
    until = monotonic() + seconds
    while not condition():
        assert monotonic() < until
        time.sleep(0.01)


def test_a_publisher_is_asked_only_while_somebody_listens(running):
    publisher = Publisher()
    running.aim(publisher)
    publisher.server.settimeout(0.3)
    with pytest.raises(TimeoutError):
        publisher.server.accept()
    publisher.server.settimeout(10)
    one, other = running.listen(), running.listen()
    source = publisher.accept()
    assert source.asked["md5sum"] == "*" and source.asked["topic"] == "/chatter"
    for listener in (one, other):
        header = listener.header()
        assert header["md5sum"] == SUM and header["topic"] == "/k/chatter" and header["latching"] == "0"
        assert header["message_definition"] == "string data" and header["callerid"] == "/relay"
    source.say(message(b"hello"))
    assert one.next() == other.next() == message(b"hello")
    publisher.server.settimeout(0.3)
    with pytest.raises(TimeoutError):  # one connection for both
        publisher.server.accept()
    one.close()
    other.close()
    with pytest.raises(EOFError):  # nobody listens any more
        source.next()


def test_each_latched_publisher_is_heard_by_who_comes_late(running):
    publishers = Publisher(), Publisher(), Publisher()
    running.aim(*publishers)
    early = running.listen()
    sources = [of.accept(latching=latching) for of, latching in zip(publishers, "110")]
    assert early.header()["latching"] in ("0", "1")
    for number, source in enumerate(sources):
        source.say(message(b"old%d" % number))
        source.say(message(b"new%d" % number))
    said = [message(b"%s%d" % (word, number)) for word in (b"old", b"new") for number in range(3)]
    assert sorted(early.next() for _number in range(6)) == sorted(said)
    late = running.listen()
    assert late.header()["latching"] == "1"
    assert {late.next(), late.next()} == {message(b"new0"), message(b"new1")}
    sources[2].say(message(b"now"))
    assert late.next() == message(b"now")


def test_a_publisher_that_comes_back_is_connected_again(running):
    publisher = Publisher()
    running.aim(publisher)
    listener = running.listen()
    first = publisher.accept()
    assert listener.header()
    first.close()
    publisher.accept().say(message(b"again"))
    assert listener.next() == message(b"again")


def test_who_asks_for_another_definition_gets_an_error(running):
    publisher = Publisher()
    running.aim(publisher)
    right, wrong = running.listen(md5sum=SUM), running.listen(md5sum="b" * 32)
    publisher.accept()
    assert "error" not in right.header()
    assert "b" * 32 in wrong.header()["error"]
    with pytest.raises((EOFError, ConnectionError)):
        wrong.next()


def test_each_listener_hears_those_with_its_own_definition(running):
    """The first publisher may have a wrong definition, or a newer one. Listeners of the others are served all the same."""
    one, other = Publisher(), Publisher()
    running.aim(one, other)
    listener, stranger = running.listen(md5sum=SUM), running.listen(md5sum="c" * 32)
    far = other.accept(md5sum="c" * 32)
    assert stranger.header()["md5sum"] == "c" * 32
    near = one.accept()
    assert listener.header()["md5sum"] == SUM
    far.say(message(b"other"))
    near.say(message(b"right"))
    assert listener.next() == message(b"right") and stranger.next() == message(b"other")


def test_a_publisher_of_another_definition_is_left_out(running):
    one, other = Publisher(), Publisher()
    running.aim(one)
    listener = running.listen()
    source = one.accept()
    assert listener.header()["md5sum"] == SUM
    running.aim(one, other)
    stranger = other.accept(md5sum="c" * 32)
    stranger.say(message(b"wrong"))
    source.say(message(b"right"))
    assert listener.next() == message(b"right")


def test_a_publisher_with_another_definition_than_before(running):
    """It was built anew: whoever listens has to ask again."""
    publisher = Publisher()
    running.aim(publisher)
    listener = running.listen()
    source = publisher.accept()
    assert listener.header()["md5sum"] == SUM
    source.close()
    publisher.accept(md5sum="c" * 32).say(message(b"other"))
    with pytest.raises((EOFError, ConnectionError)):
        listener.next()
    again = running.listen()
    publisher.accept(md5sum="c" * 32)
    assert again.header()["md5sum"] == "c" * 32


def test_listeners_of_one_publisher_end_with_it():
    running = Running(of_one=True)
    try:
        publisher = Publisher()
        running.aim(publisher)
        listener = running.listen()
        source = publisher.accept(latching="1")
        source.say(message(b"old"))
        assert listener.header() and listener.next() == message(b"old")
        source.close()
        with pytest.raises((EOFError, ConnectionError)):
            listener.next()
        late = running.listen()
        publisher.accept(latching="1").say(message(b"new"))
        assert late.header() and late.next() == message(b"new"), "and nothing of the one before"
    finally:
        running.stop()


def test_a_listener_that_never_reads_holds_nobody_up(running):
    publisher = Publisher()
    running.aim(publisher)
    idle, awake = running.listen(), running.listen()
    source = publisher.accept()
    assert awake.header()
    large = message(bytes(1 << 20))
    for number in range(60):
        source.say(large)
        source.say(message(b"%d" % number))
        assert awake.next() == large and awake.next() == message(b"%d" % number)
    assert running.do(running.feed.count_dropped) > 10
    assert running.feed._budget.used < 8 << 20
    idle.close()


def test_a_slow_link_gets_the_newest(running):
    publisher = Publisher()
    running.aim(publisher)
    slow = running.listen(newest=True)
    source = publisher.accept()
    for number in range(2000):
        source.say(message(struct.pack("<I", number) + bytes(10000)))
    wait_for(lambda: running.feed.messages == 2000)
    assert slow.header()
    numbers = []
    while not numbers or numbers[-1] != 1999:
        numbers.append(struct.unpack_from("<I", slow.next(), 4)[0])
    assert numbers == sorted(numbers) and len(numbers) < 1000


def test_a_rate_is_kept(running):
    publisher = Publisher()
    running.aim(publisher)
    listener = running.listen(rate=20.0)
    source = publisher.accept()
    assert listener.header()
    began, numbers = monotonic(), []
    for number in range(100):
        source.say(message(struct.pack("<I", number)))
        time.sleep(0.01)
    while not numbers or numbers[-1] != 99:  # the last one follows
        numbers.append(struct.unpack_from("<I", listener.next(), 4)[0])
    assert len(numbers) <= (monotonic() - began) * 20 + 2


HOSTILE = {
    "no header": b"x" * 50,
    "a header of 4 GB": struct.pack("<I", 2**32 - 1) + bytes(1000),
    "a large header": struct.pack("<I", MAX_HEADER + 1) + bytes(MAX_HEADER + 1),
    "no md5sum": encode_header({"callerid": "/x"}),
    "an error": encode_header({"error": "\x1b[2Jno\n<0>"}),
    "nothing": b"",
}


@pytest.mark.parametrize("what", HOSTILE)
def test_a_hostile_publisher_is_asked_again_later(running, what):
    hostile, good = Publisher(), Publisher()
    running.aim(hostile, good)
    listener = running.listen()
    connection = hostile.server.accept()[0]
    with contextlib.suppress(OSError):
        connection.sendall(HOSTILE[what])
        connection.shutdown(socket.SHUT_WR)
    source = good.accept()
    source.say(message(b"fine"))
    assert listener.header()["md5sum"] == SUM and listener.next() == message(b"fine")
    hostile.server.accept()


@pytest.mark.slow
def test_a_publisher_that_was_away_for_long_is_heard_soon(running):
    """At the same place: nothing else tells that it is back."""
    publisher = Publisher()
    publisher.server.close()
    publisher.place = ("127.0.0.1", free_port())
    running.aim(publisher)
    listener = running.listen()
    time.sleep(9)
    publisher.server = socket.create_server(publisher.place)
    publisher.server.settimeout(2)
    publisher.accept().say(message(b"back"))
    assert listener.header() and listener.next() == message(b"back")


def test_what_a_publisher_says_is_quoted(running, monkeypatch):
    said, publisher = [], Publisher()
    monkeypatch.setattr(running.feed._limited, "say", lambda *words: said.append(words))
    running.aim(publisher)
    listener = running.listen()
    while not said:  # it is told when it has failed some times
        with publisher.server.accept()[0] as connection:
            connection.sendall(encode_header({"error": "all is well"}))
            connection.recv(1000)
            connection.recv(1)
    assert listener and mentions(said[0][2], "/chatter", "all is well")


def test_a_message_that_is_too_long_is_left_out(running):
    publisher = Publisher()
    running.aim(publisher)
    listener = running.listen()
    source = publisher.accept()
    assert listener.header()
    source.say(struct.pack("<I", (1 << 24) + 1))
    for _number in range(1 << 4):
        source.say(bytes(1 << 20))
    source.say(b"x" + message(b"next"))
    assert listener.next() == message(b"next")
    assert running.do(running.feed.count_dropped) == 1, "and counted"


@pytest.mark.slow
@pytest.mark.parametrize("dear", DEAR)
def test_messages_that_cost_much_have_a_share(running, dear):
    """Eight publishers of one robot: the loop turns all the same, and has a rest."""
    publishers = [Publisher() for _number in range(8)]
    running.change = lambda frame: b"k/" + frame
    running.aim(*publishers)
    listener, tick, times = running.listen(), running.tick, []

    def count_turn(now):
        times.append(processor_time())
        return tick(now)

    running.tick = count_turn
    running.do(lambda: None)
    sources = [of.accept(type="x/Y", message_definition=DEEP) for of in publishers]
    until = monotonic() + 4.0

    def talk(source):
        with contextlib.suppress(OSError):
            while monotonic() < until:
                source.say(DEAR[dear])

    for source in sources:
        threading.Thread(target=talk, args=(source,), daemon=True).start()
    time.sleep(until - monotonic())
    longest = max(after - before for before, after in zip(times, times[1:]))
    print(f"{len(times)} turns, the longest {1000 * longest:.0f} ms")
    assert longest < 0.1 and times[-1] - times[0] < 0.7 * 4.0
    assert running.accounts.list_slowed() in ([], ["talker"])  # a busy machine may have slowed it before
    listener.close()
