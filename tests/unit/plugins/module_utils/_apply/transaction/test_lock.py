# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The lock of a run, held by real processes."""

import contextlib
import errno
import os
import random
import shutil
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import ansible_collections
import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.transaction import lock
from ansible_collections.rosfleet.multimaster.plugins.module_utils._base.problem import Problem
from mentioned import mentions

COLLECTIONS = Path(next(iter(ansible_collections.__path__))).parent

# Adds one to a number in a file, which two at once would do as one; `folder` is that of the records.
COUNT = """
import random, sys, time
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.transaction import lock
folder, path, times, seed = sys.argv[1:]
chance = random.Random(int(seed))
for _round in range(int(times)):
    time.sleep(chance.random() * 0.01)
    with lock.hold([folder], "count"):
        number = int(open(path).read())
        time.sleep(chance.random() * 0.002)
        with open(path, "w") as stream:
            stream.write(str(number + 1))
"""
HOLD = """
import sys, time
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.transaction import lock
with lock.hold(sys.argv[1:2], "routes"):
    print("held", flush=True)
    time.sleep(60)
"""


def process(program, *arguments, **options):
    environment = {**os.environ, "PYTHONPATH": str(COLLECTIONS)}
    return subprocess.Popen([sys.executable, "-c", program, *map(str, arguments)], env=environment, **options)


@contextlib.contextmanager
def holder(folder):
    """A process that holds the lock."""
    with process(HOLD, folder, stdout=subprocess.PIPE, text=True) as held:
        try:
            assert held.stdout.readline() == "held\n"
            yield held
        finally:
            held.kill()


@pytest.fixture
def records(tmp_path):
    return tmp_path / "var/lib/records"


@pytest.mark.slow
def test_runs_at_once_go_one_after_the_other(tmp_path):
    number = tmp_path / "number"
    number.write_text("0")
    running = [process(COUNT, tmp_path / "records", number, 50, seed) for seed in range(4)]
    assert [one.wait(60) for one in running] == [0] * 4
    assert number.read_text() == "200"
    assert list(tmp_path.iterdir()) == [number]


def test_nothing_is_left_of_a_lock_and_what_was_there_stays(records):
    records.parent.mkdir(parents=True)
    with lock.hold([str(records)], "example") as sentences:
        assert sentences == []
        assert (records / "lock").stat().st_mode & 0o777 == 0o600
    assert list(records.parent.iterdir()) == []
    records.mkdir()
    (records / "sysctl.json").touch()
    with lock.hold([str(records)], "example"):
        pass
    assert [path.name for path in records.iterdir()] == ["sysctl.json"]


def test_a_run_that_does_not_end_is_named(records, monkeypatch):
    monkeypatch.setattr(lock, "WAIT", 0.2)
    with holder(records) as held:
        with pytest.raises(Problem) as problem, lock.hold([str(records)], "example"):
            raise AssertionError("both have it")
        assert mentions(str(problem.value), held.pid, "routes")
        assert f"kill {held.pid}" in str(problem.value)
        with pytest.raises(Problem, match="has not ended within 0.2 s"):
            lock.read_undisturbed(str(records), lambda: None)


def test_a_killed_run_frees_it(records):
    with holder(records) as held:
        os.kill(held.pid, signal.SIGKILL)
        held.wait()
        assert (records / "lock").exists()
        with lock.hold([str(records)], "example") as sentences:
            assert sentences == []
    assert not (records / "lock").exists()


@pytest.mark.skipif(os.geteuid() != 0, reason="needs root, to become another user")
def test_an_ordinary_user_cannot_hold_it(tmp_path):
    records = tmp_path / "records"
    for folder in [tmp_path, *tmp_path.parents[:2]]:
        folder.chmod(0o755)
    with lock.hold([str(records)], "example"):
        words = ["sh", "-c", 'exec 9< "$0"; flock --shared 9', records / "lock"]
        tried = subprocess.run(words, user=65534, cwd="/", capture_output=True, text=True, check=False)
    assert "Permission denied" in tried.stderr


def test_where_there_can_be_no_lock_a_sentence_says_so(tmp_path):
    (tmp_path / "file").touch()
    with lock.hold([str(tmp_path / "file")], "example") as sentences:
        assert [("file/lock cannot be locked" in one, "(File exists)" in one) for one in sentences] == [(True, True)]


def test_nothing_is_left_where_a_folder_cannot_be_made(records):
    with lock.hold([str(records / ("long" * 100))], "example") as sentences:
        assert len(sentences) == 1 and "File name too long" in sentences[0]
        assert list(records.parents[2].iterdir()) == []


def refuse(*_arguments):
    raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK))


def test_nothing_is_left_on_a_file_system_without_locks(records, monkeypatch):
    monkeypatch.setattr(lock.fcntl, "flock", refuse)
    with lock.hold([str(records)], "example") as sentences:
        assert len(sentences) == 1 and "No locks available" in sentences[0]
        assert list(records.parents[2].iterdir()) == []


def test_a_lock_of_another_stays_where_none_can_be_had(records, monkeypatch):
    with holder(records), monkeypatch.context() as patch:
        patch.setattr(lock.fcntl, "flock", refuse)
        with lock.hold([str(records)], "example") as sentences:
            assert (len(sentences), (records / "lock").exists()) == (1, True)


def test_folders_of_two_that_begin_at_once_are_removed(records, monkeypatch):
    make, raced = os.mkdir, []

    def make_late(path, *mode):
        if path == str(records) and not raced:  # another run makes it just before
            raced.append(path)
            make(path)
        make(path, *mode)

    monkeypatch.setattr(os, "mkdir", make_late)
    with lock.hold([str(records)], "example") as sentences:
        assert sentences == []
    assert raced and list(records.parents[2].iterdir()) == []


def test_a_folder_that_goes_after_a_long_wait_is_made_again(records, monkeypatch):
    """The run that was waited for removes it, and another one may do so just before it is locked."""
    monkeypatch.setattr(lock, "_VANISHING", 0.1)
    make, gone = lock.atomic.make_folders, []

    def remove_again(place):
        made = make(place)
        if not gone:
            gone.append(records)
            records.rmdir()
        return made

    with holder(records) as held:
        monkeypatch.setattr(lock.atomic, "make_folders", remove_again)
        end = threading.Timer(0.4, lambda: (shutil.rmtree(records), held.kill()))
        end.start()
        with lock.hold([str(records)], "example") as sentences:
            assert (sentences, gone) == ([], [records])
        end.join()


def test_a_link_in_its_place_is_not_followed(records):
    records.mkdir(parents=True)
    (records / "lock").symlink_to(records / "other")
    with lock.hold([str(records)], "example") as sentences:
        assert len(sentences) == 1
    assert [path.name for path in records.iterdir()] == ["lock"]


def test_a_path_that_is_not_absolute_is_for_the_run_to_refuse(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with lock.hold(["records"], "example") as sentences:
        assert (sentences, os.listdir()) == ([], [])


# Check mode

# Changes two files to one value, over and over, with the lock.
ALTERNATE = """
import random, sys, time
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.transaction import lock
folder, first, second, seed = sys.argv[1:]
chance = random.Random(int(seed))
while True:
    with lock.hold([folder], "alternate"):
        for path in (first, second):
            with open(path, "r+") as stream:
                stream.write("ab"[int(open(first).read() == "a")] if path == first else open(first).read())
            time.sleep(chance.random() * 0.02)
    time.sleep(0.01 + chance.random() * 0.03)
"""


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_check_mode_reads_no_state_between_two(records, tmp_path, seed):
    files = [tmp_path / "first", tmp_path / "second"]
    for file in files:
        file.write_text("a")
    chance = random.Random(seed)

    def read():
        found = [files[0].read_text()]
        time.sleep(chance.random() * 0.01)
        return [*found, files[1].read_text()]

    with process(ALTERNATE, records, *files, seed) as changing:
        try:
            while files[1].read_text() == "a":  # it has begun
                time.sleep(0.01)
            found = [lock.read_undisturbed(str(records), read) for _time in range(40)]
            torn = [read() for _time in range(400)]
        finally:
            changing.kill()
    assert all(len(set(pair)) == 1 for pair in found)
    assert any(len(set(pair)) == 2 for pair in torn)  # what a look without waiting would have found


def test_a_refusal_of_a_half_state_is_looked_at_again(records):
    records.mkdir(parents=True)
    looks = []

    def read():
        looks.append(None)
        if len(looks) == 1:
            (records / "routes.json").touch()  # as a run would that begins now
            raise Problem("Half a state.")
        return "whole"

    assert (lock.read_undisturbed(str(records), read), len(looks)) == ("whole", 2)


@pytest.mark.parametrize("refuses", [False, True])
def test_a_reading_that_is_always_disturbed_is_none(records, monkeypatch, refuses):
    monkeypatch.setattr(lock, "WAIT", 0.1)
    records.mkdir(parents=True)

    def read():
        (records / str(time.monotonic_ns())).touch()  # as a run would that begins now
        time.sleep(0.01)
        if refuses:
            raise Problem("Half a state.")
        return "half"

    with pytest.raises(Problem, match=r"runs.*0\.1"):
        lock.read_undisturbed(str(records), read)


def test_check_mode_makes_nothing(records, tmp_path):
    assert lock.read_undisturbed(str(records), lambda: 7) == 7
    assert list(tmp_path.iterdir()) == []
