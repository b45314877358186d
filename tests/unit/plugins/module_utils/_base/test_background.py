# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Doors of processes that outlive their module: an older process has put its own away before a new one opens."""

import socket
import tempfile
import threading
import time

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._base import background
from ansible_collections.rosfleet.multimaster.plugins.module_utils._base.problem import Problem
from ansible_collections.rosfleet.multimaster.plugins.modules import multimaster_watch
from mentioned import mentions


@pytest.fixture(name="path")
def fixture_path(monkeypatch):
    """A door below /tmp itself: with pytest's folders, and a user of a long name, it would have more than 107 letters."""
    with tempfile.TemporaryDirectory() as folder:
        monkeypatch.setattr(background, "FOLDER", f"{folder}/doors")
        yield background.path_of("test", "run")


def leave(door, path, pause=0.0):
    """A process that ends as soon as it is asked, and puts its door away after its answer."""

    def serve():
        with door:
            background.answer(background.admit(door)[0], {})
            time.sleep(pause)
            background.remove_door(path)

    thread = threading.Thread(target=serve)
    thread.start()
    return thread


@pytest.mark.slow
@pytest.mark.parametrize("pause", [0.0, 0.3])
def test_an_older_process_has_put_its_door_away(path, pause):
    for _time in range(4):
        older = leave(background.open_door(path), path, pause)
        background.end_others("test")
        background.open_door(path).close()
        background.remove_door(path)
        older.join(5)
        assert not older.is_alive()


def test_of_two_that_begin_together_the_later_one_stays(path):
    first = leave(background.open_door(path), path)
    with background.open_door(path) as second:
        first.join(5)
        assert not first.is_alive()
        background.Visit(path, {"do": "tell"})
        assert background.admit(second)[1] == {"do": "tell"}


@pytest.mark.parametrize("late", [1, background.VISITS])
def test_a_visitor_that_is_held_up_comes_again(path, monkeypatch, late):
    class LateSocket(socket.socket):
        left = late

        def sendall(self, data):
            if LateSocket.left:  # until the process no longer waits
                LateSocket.left -= 1
                assert self.recv(1) == b""
            super().sendall(data)

    monkeypatch.setattr(background, "REQUEST", 0.05)
    admitted = []

    def serve(door):
        while not admitted or admitted[-1] is None:
            admitted.append(background.admit(door))

    with background.open_door(path) as door:
        thread = threading.Thread(target=serve, args=(door,))
        thread.start()
        monkeypatch.setattr(background.socket, "socket", LateSocket)
        if late == background.VISITS:
            with pytest.raises(BrokenPipeError):
                background.Visit(path, {"do": "tell"})
        background.Visit(path, {"do": "tell"})
        thread.join(5)
    assert len(admitted) > late and admitted[-1][1] == {"do": "tell"}


def test_a_door_that_is_in_use_is_an_error(path, monkeypatch):
    monkeypatch.setattr(background, "ENDING", 0.05)
    with background.open_door(path), pytest.raises(OSError, match="Address already in use"):
        background.open_door(path)


def test_the_door_of_a_killed_process_is_removed(path):
    for end in (lambda: background.end_others("test"), lambda: background.open_door(path).close()):
        background.open_door(path).close()
        end()
        background.remove_door(path)


@pytest.mark.parametrize("problem", [BrokenPipeError, ConnectionResetError, FileNotFoundError])
def test_a_process_that_ends_meanwhile_is_no_error(path, monkeypatch, problem):
    class Visit:
        def __init__(self, at, _request):
            background.remove_door(at)
            raise problem(1, "gone")

    monkeypatch.setattr(background, "Visit", Visit)
    with background.open_door(path):
        background.end_others("test")


def test_a_process_of_another_user_is_a_sentence(path, monkeypatch):
    monkeypatch.setattr(multimaster_watch, "KIND", "test")
    monkeypatch.setattr(background.os, "geteuid", lambda: 4711)
    with background.open_door(path), pytest.raises(Problem) as failed:
        multimaster_watch.stop_watches({}, False)
    assert str(failed.value).startswith("Cannot end the watches of this computer: ")
    assert mentions(str(failed.value), "root", "become")
