# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The reasons for which this kernel drops packets of 127.0.0.1, as its own tracefs tells them."""

import contextlib
import json
import os
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

import ansible_collections
import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.trace import drops, listener
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.trace.capture import Tag

COLLECTIONS = Path(next(iter(ansible_collections.__path__))).parent
NO_SOCKET = "drop reason NO_SOCKET"
SENT = 50  # far more than others on this machine send to closed ports meanwhile


@pytest.fixture(scope="module")
def tracefs(tmp_path_factory):
    """The tracefs of this kernel, at a place of its own."""
    place = tmp_path_factory.mktemp("tracefs")
    mounted = subprocess.run(["mount", "-t", "tracefs", "tracefs", place], check=False, capture_output=True, text=True)
    if mounted.returncode:
        pytest.skip(f"no tracefs: {mounted.stderr.strip()}")
    yield place
    subprocess.run(["umount", place], check=True)


def send_to_nobody():
    """Send to a port that is closed, so the kernel drops what comes."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender, socket.socket(socket.AF_INET) as closed:
        closed.bind(("127.0.0.1", 0))
        for _number in range(SENT):
            sender.sendto(b"x", closed.getsockname())
    time.sleep(0.1)


def wait_until(holds):
    deadline = time.monotonic() + 10
    while not holds():
        assert time.monotonic() < deadline
        time.sleep(0.01)


def list_instances(tracefs):
    return sorted((tracefs / "instances").glob("rosfleet*"))


def is_on(folder):
    return (folder / "events" / "skb" / "kfree_skb" / "enable").read_text().strip() == "1"


def test_a_drop_has_its_reason_and_nothing_stays_on(tracefs):
    send_to_nobody()
    with drops.DropReasons(str(tracefs)) as reasons:
        before = reasons.read()
        send_to_nobody()
        after = reasons.read()
        (folder,) = list_instances(tracefs)
        assert is_on(folder) and not is_on(tracefs)  # not for all others
    assert after[NO_SOCKET] >= SENT > before.get(NO_SOCKET, 0)
    assert not [name for name in after if "NOT_SPECIFIED" in name] and not list_instances(tracefs)


LISTEN = """
import sys, time
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.trace import drops
with drops.DropReasons(sys.argv[1]):
    print("listens", flush=True)
    time.sleep(60)
"""
CONTAINER = ["unshare", "--net"]


@contextlib.contextmanager
def run_listener(tracefs, *before):
    """A process that listens until it is killed at the end."""
    words = [*before, sys.executable, "-c", LISTEN, str(tracefs)]
    environment = {**os.environ, "PYTHONPATH": str(COLLECTIONS)}
    with subprocess.Popen(words, env=environment, stdout=subprocess.PIPE, text=True) as listening:
        try:
            assert listening.stdout.readline() == "listens\n"
            yield
        finally:
            listening.kill()


def test_what_a_killed_listener_left_is_taken_over(tracefs):
    with run_listener(tracefs):
        send_to_nobody()
    assert list(map(is_on, list_instances(tracefs))) == [True]
    with drops.DropReasons(str(tracefs)) as reasons:
        assert reasons.read().get(NO_SOCKET, 0) < SENT
        send_to_nobody()
        assert reasons.read()[NO_SOCKET] >= SENT
    assert not list_instances(tracefs)


def test_what_killed_containers_left_is_removed(tracefs):
    with run_listener(tracefs, *CONTAINER), run_listener(tracefs, *CONTAINER):
        pass
    assert list(map(is_on, list_instances(tracefs))) == [True, True]
    with drops.DropReasons(str(tracefs)):
        assert len(list_instances(tracefs)) == 1
    assert not list_instances(tracefs)


def test_a_listener_that_lives_keeps_its_own(tracefs):
    with run_listener(tracefs, *CONTAINER):
        with drops.DropReasons(str(tracefs)):
            assert list(map(is_on, list_instances(tracefs))) == [True, True]
        assert list(map(is_on, list_instances(tracefs))) == [True]
    with drops.DropReasons(str(tracefs)):
        pass
    assert not list_instances(tracefs)


def test_two_of_one_network_do_not_share(tracefs):
    with drops.DropReasons(str(tracefs)) as first:
        with drops.DropReasons(str(tracefs)) as second:
            send_to_nobody()
            assert second.read() == {}
        assert first.read()[NO_SOCKET] >= SENT


@pytest.mark.parametrize("name", ["rosfleet_packet_traceer", "rosfleet_packet_trace_1_x", "rosfleet_other"])
def test_what_has_another_name_is_not_ours(tracefs, name):
    other = tracefs / "instances" / name
    other.mkdir()
    try:
        with drops.DropReasons(str(tracefs)):
            pass
        assert list_instances(tracefs) == [other]
    finally:
        other.rmdir()


def test_one_that_is_removed_before_it_is_locked_is_made_again(tracefs, monkeypatch):
    lock, removed = drops.fcntl.flock, []

    def remove_first(descriptor, kind):
        if not removed:
            removed.extend(list_instances(tracefs))
            removed[0].rmdir()
        lock(descriptor, kind)

    monkeypatch.setattr(drops.fcntl, "flock", remove_first)
    with drops.DropReasons(str(tracefs)):
        assert list_instances(tracefs) == removed and is_on(removed[0])
    assert not list_instances(tracefs)


def test_one_that_another_has_made_again_is_not_taken(tracefs, monkeypatch):
    lock, made = drops.fcntl.flock, []

    def make_again(descriptor, kind):
        if not made:
            made.extend(list_instances(tracefs))
            made[0].rmdir()
            made[0].mkdir()
            made.append(drops._open(str(made[0])))
            lock(made[1], kind)
        lock(descriptor, kind)

    monkeypatch.setattr(drops.fcntl, "flock", make_again)
    try:
        with drops.DropReasons(str(tracefs)) as reasons:
            assert reasons.read() == {}
        assert list_instances(tracefs) == made[:1]
    finally:
        os.close(made[1])
        made[0].rmdir()


def test_one_that_another_has_locked_stops_nobody(tracefs, monkeypatch):
    """Others have removed ours and made it again, or are stopped while they look at it."""
    open_folder, other = drops._open, []

    def lose(folder):
        if not other:
            os.rmdir(folder)
            os.mkdir(folder)
            other.append(open_folder(folder))
            drops.fcntl.flock(other[0], drops.fcntl.LOCK_EX)
        return open_folder(folder)

    monkeypatch.setattr(drops, "_open", lose)
    try:
        with drops.DropReasons(str(tracefs)) as reasons:
            assert reasons.read() == {}
        (folder,) = list_instances(tracefs)
        assert drops._is_at(other[0], str(folder))
    finally:
        os.close(other[0])
        folder.rmdir()


def test_the_listener_tells_the_reasons(tracefs, monkeypatch, tmp_path):
    monkeypatch.setattr(listener, "DropReasons", lambda: drops.DropReasons(str(tracefs)))
    monkeypatch.setattr(listener, "count_lost", lambda link: 0)  # it is no packet socket
    (link, other), path = socket.socketpair(), str(tmp_path / "door")
    with link, other, socket.socket(socket.AF_UNIX) as door, socket.socket(socket.AF_UNIX) as visitor:
        link.setblocking(False)
        door.bind(path)
        door.listen()
        thread = threading.Thread(target=listener.serve, args=(link, door, path, Tag.from_run("test"), 20.0, {}))
        thread.start()
        wait_until(lambda: any(is_on(folder) for folder in list_instances(tracefs)))
        send_to_nobody()
        visitor.connect(path)
        visitor.sendall(b"{}\n")
        reply = json.loads(visitor.makefile().readline())
        thread.join(20)
    assert {one["counter"]: one["more"] for one in reply["counters"]}[NO_SOCKET] >= SENT
    assert not list_instances(tracefs)


def test_where_there_is_no_tracefs_there_are_no_reasons(tmp_path):
    with drops.DropReasons(str(tmp_path)) as reasons:
        assert reasons.read() == {}
    assert os.listdir(tmp_path) == []


def test_an_error_ends_it_as_well(tracefs):
    with pytest.raises(ValueError, match="of the listener"), drops.DropReasons(str(tracefs)):
        raise ValueError("of the listener")
    assert not list_instances(tracefs)
