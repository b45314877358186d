# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Commands with a limit of time."""

import importlib
import linecache
import subprocess
import threading
import time
import zipfile
from pathlib import Path

from ansible_collections.rosfleet.multimaster.plugins.module_utils._base import commands
from mentioned import mentions


def until_gone(note):
    """Wait until a process has ended; one that nobody has buried yet has no command line."""
    path = Path(f"/proc/{note.read_text().strip()}/cmdline")
    deadline = time.monotonic() + 10
    while path.exists() and path.read_bytes():
        assert time.monotonic() < deadline
        time.sleep(0.05)


def test_a_command_answers_with_its_status_and_its_output():
    answer = commands.run(["sh", "-c", "cat; echo said >&2; exit 3"], given=b"given")
    assert answer == commands.Answer(3, b"given", "said")


def test_a_command_is_waited_for_without_polling(monkeypatch):
    def no_sleep(seconds):
        raise AssertionError(f"slept {seconds} s")

    monkeypatch.setattr(subprocess.time, "sleep", no_sleep)
    assert commands.run(["sleep", "0.2"]).status == 0


def test_a_command_that_is_too_slow_ends_with_all_its_processes(tmp_path):
    note = tmp_path / "pid"
    began = time.monotonic()
    answer = commands.run(["sh", "-c", f"sleep 77 & echo $! > {note}; wait"], limit=0.5)
    assert answer == commands.Answer(-1, b"", "sh gave no answer within 0.5 s")
    assert time.monotonic() - began < 60
    until_gone(note)


def test_what_a_command_leaves_behind_ends_with_it(tmp_path):
    note = tmp_path / "pid"
    assert commands.run(["sh", "-c", f"sleep 78 >/dev/null 2>&1 & echo $! > {note}"]).status == 0
    until_gone(note)


def test_a_command_without_room_for_what_it_says_is_a_sentence(monkeypatch):
    def full(*_words, **_more):
        raise FileNotFoundError(2, "No usable temporary directory found in ['/tmp']")

    monkeypatch.setattr(commands.tempfile, "TemporaryFile", full)
    answer = commands.run(["true"])
    assert answer.status == -1 and mentions(answer.error, "temporary", "usable")


def test_a_command_that_is_not_there_is_a_sentence():
    answer = commands.run(["no-such-command"])
    assert answer.status == -1 and mentions(answer.error, "no-such-command", "No such file")


def test_threads_read_the_source_of_a_module_in_an_archive(tmp_path, monkeypatch):
    """As on a robot: with `inspect`, a thread at times found no source, and what it was to ask was unknown."""
    text = "X = 1\n" * 400
    with zipfile.ZipFile(tmp_path / "modules.zip", "w") as archive:
        archive.writestr("packed_module.py", text)
    monkeypatch.syspath_prepend(str(tmp_path / "modules.zip"))
    module = importlib.import_module("packed_module")
    found, together = [], threading.Barrier(4)

    def read():
        together.wait()
        found.append(commands.read_source(module))

    for _round in range(300):
        linecache.clearcache()
        threads = [threading.Thread(target=read) for _number in range(4)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    assert found == [text] * 1200


def test_no_module_asks_inspect_for_a_source():
    """Its cache is not safe among threads."""
    root = Path(commands.__file__).resolve().parents[1]
    assert [path for path in root.rglob("*.py") if "getsource" in path.read_text(encoding="utf-8")] == []
