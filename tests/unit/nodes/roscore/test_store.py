# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The store in a folder: killed at every call that changes a file, a full disk, a damaged file."""

import errno
import logging
import os
import signal
import threading
import time
from decimal import Decimal

import pytest
from rosfleet_multimaster.roscore import store
from rosfleet_multimaster.roscore.core import store_format
from rosfleet_multimaster.roscore.core.registry import Registry

from tests.unit.nodes.roscore.records import rec

CALLS = ("open", "write", "replace", "fdatasync", "ftruncate", "remove", "makedirs", "fsync")


class Roscore:
    """A registry that counts: the parameter /count."""

    def __init__(self, folder):
        self.registry, self.lock = Registry(), threading.RLock()
        self.store = store.Store(str(folder), self.lock, self.parts)

    def parts(self):
        with self.lock:
            records = [rec("set", "/", self.registry.parameters), *self.registry.facts.values()]
        for at in range(0, len(records), 2):
            yield records[at : at + 2]

    def change(self, count):
        records = [
            rec("set", "/count", count),
            rec("node", f"/node_{count % 5}", f"http://robot:{count}/" if count % 3 else ""),
        ]
        with self.lock:
            for record in records:
                self.registry.apply(record)
            self.store.add(records)


def state(count):
    roscore = Roscore("/nowhere")
    for number in range(1, count + 1):
        roscore.change(number)
    return vars(roscore.registry)


@pytest.fixture
def quick(monkeypatch):
    """No pauses, and a store that is written anew at every second change."""
    monkeypatch.setattr(store, "sleep", lambda _seconds: None)
    monkeypatch.setattr(store.store_format, "is_renewal_due", lambda _size, _base: True)


def in_child(work):
    """Run in a process of its own: whether it was killed, and what it wrote to the pipe."""
    reader, writer = os.pipe()
    write = os.write
    child = os.fork()
    if child == 0:
        try:
            work(lambda count: write(writer, bytes([count])))
        finally:
            os._exit(0)
    os.close(writer)
    told = b""
    while piece := os.read(reader, 100):
        told += piece
    os.close(reader)
    return os.WIFSIGNALED(os.waitpid(child, 0)[1]), list(told)


def kill_at(step, half):
    """Have the process killed at this call; half of a write is done before."""
    counted = [0]

    def guarded(name):
        real = getattr(os, name)

        def call(*arguments, **options):
            counted[0] += 1
            if counted[0] == step:
                if name == "write" and half:
                    real(arguments[0], arguments[1][: len(arguments[1]) // 2])
                os.kill(os.getpid(), signal.SIGKILL)
            return real(*arguments, **options)

        return call

    for name in CALLS:
        setattr(store.os, name, guarded(name))


@pytest.mark.slow
@pytest.mark.parametrize("half", [False, True])
def test_killed_at_any_call_nothing_that_was_answered_is_lost(tmp_path, quick, half):
    kills = step = 0
    while True:
        step += 1
        folder = tmp_path / f"{step}"

        def work(answered, folder=folder, step=step):
            roscore = Roscore(folder)
            kill_at(step, half)
            roscore.store._renew(rest=False)
            for count in range(1, 8):
                roscore.change(count)
                answered(count)
                if count % 3 == 0:
                    roscore.store.sync()
                    roscore.store._renew()

        killed, told = in_child(work)
        if not killed:
            break
        kills += 1
        found = store.read(str(folder))
        last = told[-1] if told else 0
        if found is None:
            assert last == 0, f"step {step}: nothing is left, and {last} changes were answered"
        else:
            assert vars(found.registry) in (state(last), state(last + 1)), f"step {step}"
            assert not list(folder.glob("*.damaged"))
    assert kills > 15


def test_two_kills_in_a_row(tmp_path, quick):
    """A kill while the store is written anew after a kill."""
    for step in range(1, 12):
        folder = tmp_path / f"{step}"

        def first(_answered, folder=folder):
            roscore = Roscore(folder)
            roscore.store._renew(rest=False)
            for count in range(1, 5):
                roscore.change(count)
            os.kill(os.getpid(), signal.SIGKILL)

        def second(_answered, folder=folder, step=step):
            roscore = Roscore(folder)
            roscore.registry = store.read(str(folder)).registry
            kill_at(step, half=True)
            roscore.store._renew(rest=False)

        assert in_child(first)[0]
        in_child(second)
        assert vars(store.read(str(folder)).registry) == state(4)


@pytest.mark.slow
@pytest.mark.parametrize("half", [False, True])
def test_killed_at_any_call_after_a_kill_nothing_is_lost_either(tmp_path, quick, half):
    """The second life goes on in the file of the first one, and writes it anew while things change."""
    kills = step = 0
    while True:
        step += 1
        folder = tmp_path / f"{step}"

        def first(_answered, folder=folder):
            roscore = Roscore(folder)
            roscore.store._renew(rest=False)
            for count in range(1, 5):
                roscore.change(count)
            os.write(roscore.store._file, b"half of a li")
            os.kill(os.getpid(), signal.SIGKILL)

        def second(answered, folder=folder, step=step):
            found = store.read(str(folder))
            roscore = Roscore(folder)
            roscore.registry = found.registry
            kill_at(step, half)
            assert roscore.store._resume(found)
            for count in range(5, 8):
                roscore.change(count)
                answered(count)
            roscore.store._renew()
            roscore.change(8)
            answered(8)

        assert in_child(first)[0]
        killed, told = in_child(second)
        last = told[-1] if told else 4
        assert vars(store.read(str(folder)).registry) in (state(last), state(last + 1)), f"step {step}"
        assert not list(folder.glob("*.damaged"))
        if not killed:
            assert last == 8
            break
        kills += 1
    assert kills > 8


def test_a_busy_disk_keeps_no_start_after_a_kill_waiting(tmp_path, monkeypatch):
    before = Roscore(tmp_path)
    before.store._renew(rest=False)
    for count in range(1, 5):
        before.change(count)
    os.close(before.store._guard)
    synced = threading.Event()
    monkeypatch.setattr(store.os, "fdatasync", lambda _file: synced.wait(20))
    found = store.read(str(tmp_path))
    roscore = Roscore(tmp_path)
    roscore.registry = found.registry
    began = time.monotonic()
    roscore.store.start(found)
    roscore.change(5)
    assert time.monotonic() - began < 5, "it does not wait for the disk"
    assert vars(store.read(str(tmp_path)).registry) == state(5), "and what changes is kept"
    synced.set()


@pytest.mark.parametrize("what", ["another boot", "damaged", "gone", "owned"])
def test_a_file_that_cannot_be_gone_on_with_is_written_anew(tmp_path, monkeypatch, what):
    before = Roscore(tmp_path)
    before.store._renew(rest=False)
    before.change(1)
    path = tmp_path / store_format.FILE
    if what == "damaged":
        path.write_bytes(path.read_bytes() + b"nonsense\nmore\n")
    if what == "another boot":
        monkeypatch.setattr(store, "read_boot_id", lambda: "another")
    if what != "owned":
        os.close(before.store._guard)
    found = store.read(str(tmp_path))
    if what == "gone":
        path.unlink()
    roscore = Roscore(tmp_path)
    roscore.registry = found.registry
    assert not roscore.store._resume(found)
    roscore.store.start(found)
    roscore.change(2)
    assert vars(store.read(str(tmp_path)).registry) == state(1 if what == "owned" else 2)


def test_the_thread_syncs_and_writes_anew(tmp_path, monkeypatch):
    monkeypatch.setattr(store.store_format, "SLACK", 2000)
    roscore = Roscore(tmp_path)
    roscore.store.start()
    for count in range(1, 500):
        roscore.change(count)
        time.sleep(0.0005)
    until = time.monotonic() + 60
    while os.path.getsize(tmp_path / store_format.FILE) >= 6000 and time.monotonic() < until:
        time.sleep(0.05)
    assert os.path.getsize(tmp_path / store_format.FILE) < 6000
    assert vars(store.read(str(tmp_path)).registry) == state(499)


def test_a_full_disk_is_a_warning_until_there_is_room(tmp_path, monkeypatch, caplog):
    roscore, real = Roscore(tmp_path), os.write
    roscore.store._renew(rest=False)
    roscore.change(1)

    def full(file, data):
        real(file, data[:7])
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patched:
        patched.setattr(store.os, "write", full)
        with caplog.at_level(logging.WARNING):
            for count in range(2, 6):
                roscore.change(count)
            roscore.store._renew(rest=False)
    assert len(caplog.records) == 1 and "No space left" in caplog.text
    assert vars(store.read(str(tmp_path)).registry) == state(1), "what was there before"
    roscore.store._renew(rest=False)
    roscore.change(6)
    assert vars(store.read(str(tmp_path)).registry) == state(6)


def test_a_folder_that_cannot_be_written_is_a_warning(tmp_path, caplog):
    (tmp_path / "file").write_text("")
    roscore = Roscore(tmp_path / "file" / "folder")
    roscore.store._renew(rest=False)
    roscore.change(1)
    assert "cannot be kept" in caplog.text and store.read(str(tmp_path / "file" / "folder")) is None


def test_one_roscore_has_a_folder(tmp_path, caplog):
    first, second = Roscore(tmp_path), Roscore(tmp_path)
    first.store._renew(rest=False)
    first.change(1)
    second.store._renew(rest=False)
    assert "another roscore" in caplog.text
    assert vars(store.read(str(tmp_path)).registry) == state(1)


def test_a_damaged_file_counts_up_to_the_damage_and_is_put_aside(tmp_path, caplog):
    roscore = Roscore(tmp_path)
    roscore.store._renew(rest=False)
    for count in range(1, 4):
        roscore.change(count)
    path = tmp_path / store_format.FILE
    lines = path.read_bytes().splitlines(keepends=True)
    path.write_bytes(b"".join([*lines[:-2], b"?" + lines[-2][1:], lines[-1]]))
    assert vars(store.read(str(tmp_path)).registry) == state(1)
    assert "damaged" in caplog.text and (tmp_path / f"{store_format.FILE}.damaged").exists()


def test_what_counts_of_a_damaged_file_outlives_a_full_disk(tmp_path, monkeypatch):
    """The start that has put it aside cannot write a new one, and ends; so does the next."""
    before = Roscore(tmp_path)
    before.store._renew(rest=False)
    before.change(1)
    os.close(before.store._guard)
    path, damaged = tmp_path / store_format.FILE, tmp_path / f"{store_format.FILE}.damaged"
    path.write_bytes(path.read_bytes() + b"nonsense\nmore\n")
    whole = path.read_bytes()
    for _start in range(2):
        found = store.read(str(tmp_path))
        assert vars(found.registry) == state(1) and damaged.read_bytes() == whole
        roscore = Roscore(tmp_path)
        roscore.registry = found.registry
        with monkeypatch.context() as patch:
            patch.setattr(store.os, "write", fill)
            roscore.store._renew(rest=False)
        os.close(roscore.store._guard)
    roscore.store._guard = None
    roscore.store._renew(rest=False)
    assert vars(store.read(str(tmp_path)).registry) == state(1) and damaged.read_bytes() == whole


def fill(*_arguments):
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def test_another_boot_is_told(tmp_path, monkeypatch):
    roscore = Roscore(tmp_path)
    roscore.store._renew(rest=False)
    assert store.read(str(tmp_path)).size > 0
    monkeypatch.setattr(store, "read_boot_id", lambda: "another")
    assert store.read(str(tmp_path)).size == 0


def test_forgotten(tmp_path):
    assert store.read(str(tmp_path)) is None and not store.forget(str(tmp_path))
    Roscore(tmp_path).store._renew(rest=False)
    assert store.forget(str(tmp_path)) and store.read(str(tmp_path)) is None


DAMAGE = {
    "nothing": b"",
    "bytes": bytes(range(256)) * 100,
    "deep": b"[" * 100_000,
    "another format": store_format.format_line(0, {"format": 99, "boot": ""}),
    "no mapping": store_format.format_line(0, [1]),
    "a head alone and bytes": store_format.format_head("boot") + b"\0" * 5000 + b"\n",
}


@pytest.mark.parametrize("data", DAMAGE.values(), ids=DAMAGE)
def test_whatever_is_in_the_file_it_is_read_or_put_aside(tmp_path, data, caplog):
    path = tmp_path / store_format.FILE
    path.write_bytes(data)
    found = store.read(str(tmp_path))
    assert found is None or vars(found.registry) == vars(Registry())
    assert path.exists() == (found is not None), "what counts stays until a new one is written"
    assert path.with_name(f"{store_format.FILE}.damaged").read_bytes() == data
    assert len(caplog.records) == 1


@pytest.mark.parametrize("problem", [MemoryError(), RecursionError(), OSError(5, "Input/output error"), KeyError("x")])
def test_whatever_happens_while_it_is_read_the_roscore_starts(tmp_path, monkeypatch, problem):
    Roscore(tmp_path).store._renew(rest=False)

    def fail(*_arguments):
        raise problem

    monkeypatch.setattr(store.store_format, "read", fail)
    assert store.read(str(tmp_path)) is None
    assert os.listdir(tmp_path) == [f"{store_format.FILE}.damaged"]


def test_a_file_that_is_far_too_large_is_put_aside_unread(tmp_path, monkeypatch):
    monkeypatch.setattr(store, "LARGEST", 100)
    (tmp_path / store_format.FILE).write_bytes(store_format.format_head("boot") + b"x" * 100)
    assert store.read(str(tmp_path)) is None and os.listdir(tmp_path) == [f"{store_format.FILE}.damaged"]


def test_after_five_starts_that_come_to_nothing_it_is_put_aside(tmp_path):
    roscore = Roscore(tmp_path)
    roscore.store._renew(rest=False)
    roscore.change(1)
    for _start in range(store.STARTS - 1):
        assert store.read(str(tmp_path)) is not None
    store.clear_starts(str(tmp_path))
    for _start in range(store.STARTS):
        assert store.read(str(tmp_path)) is not None
    assert store.read(str(tmp_path)) is None and os.listdir(tmp_path) == [f"{store_format.FILE}.damaged"]


def test_a_value_that_cannot_be_kept_is_said_once(tmp_path, caplog):
    roscore = Roscore(tmp_path)
    roscore.store._renew(rest=False)
    deep = []
    for _level in range(5000):
        deep = [deep]
    for value in (Decimal(1), object(), "\ud800", deep, 10**5000):
        roscore.store.add([rec("set", "/strange", value), rec("set", "/tree", {"good": 1, "bad": value})])
        roscore.change(1)
    assert len(caplog.records) == 2
    assert store.read(str(tmp_path)).registry.parameters == {"count": 1, "tree": {"good": 1}}


def test_its_thread_never_ends(tmp_path, monkeypatch, caplog):
    monkeypatch.setattr(store, "SYNC", 0.001)
    monkeypatch.setattr(store, "AGAIN", 0.001)
    roscore, failures = Roscore(tmp_path), [ValueError(), RecursionError(), MemoryError(), RuntimeError()]
    roscore.store.start()

    def is_renewal_due(_size, _base):
        if failures:
            raise failures.pop()
        return False

    monkeypatch.setattr(store.store_format, "is_renewal_due", is_renewal_due)
    until, count = time.monotonic() + 60, 0
    while failures and time.monotonic() < until:  # the thread looks only when something has changed
        count += 1
        roscore.change(count)
        time.sleep(0.005)
    assert not failures
    while roscore.store._file is None and time.monotonic() < until:
        time.sleep(0.01)
    roscore.change(500)
    assert store.read(str(tmp_path)).registry.parameters == {"count": 500}


def test_frequent_changes_wait_for_a_new_file(tmp_path, monkeypatch):
    """Else the file, or what waits for the new one, would take all there is."""
    monkeypatch.setattr(store.store_format, "MOST", 1 << 20)
    monkeypatch.setattr(store, "PATIENCE", 0.2)
    roscore, slow = Roscore(tmp_path), threading.Event()
    real = os.fdatasync
    roscore.store.start()
    monkeypatch.setattr(store.os, "fdatasync", lambda file: (slow.wait(20), real(file)))
    written = 0
    while roscore.store.wait() and written < 100:
        with roscore.lock:
            roscore.store.add([rec("set", "/large", "x" * 500_000)])
        written += 1
        assert os.path.getsize(tmp_path / store_format.FILE) < 5 << 20
    assert 2 < written < 20
    slow.set()
    monkeypatch.setattr(store, "PATIENCE", 20)
    assert roscore.store.wait()
