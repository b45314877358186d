# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The process of a watch: looks that fail or hang are told, and without a visitor it ends."""

import contextlib
import socket
import threading

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._base.background import Visit, open_door
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.watch import process
from visiting import leave_silently

PARAMS = {"group": "226.0.0.0", "port": 11511, "addresses": [], "masters": []}
LOST = [{"kind": "readings", "name": "readings"}]

pytestmark = pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")  # of no_look_goes_on


@pytest.fixture(autouse=True)
def no_look_goes_on(monkeypatch):
    """The thread that looks ends with its process, which is that of the tests here."""
    monkeypatch.setattr(process, "LOOK", 0.05)
    monkeypatch.setattr(process, "TURN", 0.02)
    before = set(threading.enumerate())
    yield

    def end(params, before):
        raise SystemExit

    monkeypatch.setattr(process, "read_all", end)
    for thread in set(threading.enumerate()) - before:
        thread.join(10)
        assert not thread.is_alive()


@pytest.fixture(name="serve")
def fixture_serve(tmp_path, monkeypatch):
    """Run a watch in a thread, with looks by `read`; the path of its door."""
    path = str(tmp_path / "run" / "watch.sock")

    @contextlib.contextmanager
    def serve(read, lifetime=20.0):
        monkeypatch.setattr(process, "read_all", read)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as raw, open_door(path) as door:
            raw.setblocking(False)
            thread = threading.Thread(target=process.serve, args=(raw, door, path, {**PARAMS, "lifetime": lifetime}))
            thread.start()
            try:
                yield path, thread
            finally:
                with contextlib.suppress(OSError):
                    Visit(path, {"do": "end"}).reply(5)
                thread.join(10)
                assert not thread.is_alive()

    return serve


def collect(path, until=10):
    return Visit(path, {"until": until}).reply(15)


def test_a_look_that_fails_is_lost_and_the_next_one_returns(serve):
    """As with no free file numbers: the thread that looks lives on."""
    broken = threading.Event()

    def read(params, before):
        if broken.is_set():
            raise OSError(24, "Too many open files")
        return {("route", "default"): "10.0.0.1"}

    with serve(read) as (path, _thread):
        assert collect(path, until=0.3)["lost"] == []
        broken.set()
        told = collect(path)
        assert told["lost"] == LOST and told["seconds"] < 9
        assert told["events"][0]["found"] == "[Errno 24] Too many open files"
        broken.clear()
        told = collect(path, until=told["seconds"] + 0.5)
        assert told["lost"] == [] and told["events"][1]["well"]


def test_a_first_look_that_fails_is_a_loss(serve):
    def read(params, before):
        raise ValueError

    with serve(read) as (path, _thread):
        leave_silently(path)
        told = collect(path)
        assert told["lost"] == LOST and told["events"][0]["found"] == "ValueError"


def test_a_look_that_hangs_is_a_loss(serve, monkeypatch):
    monkeypatch.setattr(process, "SLOWEST", 0.3)
    going_on = threading.Event()
    with serve(lambda params, before: going_on.wait(20) and {}) as (path, _thread):
        told = collect(path)
        assert told["lost"] == LOST and told["events"][0]["found"] == "no look has ended for 0.3 s"
        going_on.set()


def test_a_process_that_was_held_up_has_missed_no_look(monkeypatch):
    going_on = threading.Event()
    monkeypatch.setattr(process, "read_all", lambda params, before: going_on.wait(20) and {})
    looks = process.Looks(PARAMS, 0.0)
    assert looks.take(1000.0) == []
    turns = [1000.0 + number * process.TURN for number in range(int(process.SLOWEST / process.TURN) + 2)]
    (hung,) = [found for now in turns for found in looks.take(now)][:1]
    assert process.READINGS in hung[1]
    going_on.set()


@pytest.mark.slow
def test_a_watch_whose_controller_vanished_ends(serve, monkeypatch):
    monkeypatch.setattr(process, "ABANDONED", 0.6)
    with serve(lambda params, before: {}) as (path, thread):
        for number in range(4):
            assert collect(path, until=0.3 * number)["lost"] == []
        thread.join(5)
        assert not thread.is_alive()
