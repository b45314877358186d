# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The records and the files written by rename."""

import errno
import os
import signal
import time

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.transaction import atomic, record
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.transaction.record import Record
from ansible_collections.rosfleet.multimaster.plugins.module_utils._base.problem import Problem


def test_write_replaces_content_and_mode(tmp_path):
    path = tmp_path / "file"
    path.write_bytes(b"old")
    atomic.write_by_rename(str(path), b"new", mode=0o640)
    assert path.read_bytes() == b"new"
    assert path.stat().st_mode & 0o777 == 0o640
    assert [entry.name for entry in tmp_path.iterdir()] == ["file"]


def test_failed_write_leaves_the_old_file(tmp_path):
    folder = tmp_path / "target"
    folder.mkdir()
    (folder / "inside").touch()
    with pytest.raises(OSError):
        atomic.write_by_rename(str(folder), b"a file cannot replace a folder")
    assert [entry.name for entry in tmp_path.iterdir()] == ["target"]


def test_a_killed_writer_leaves_the_old_file_or_the_new_one(tmp_path):
    path = tmp_path / "file"
    versions = [b"a" * 200_000, b"b" * 200_000]
    path.write_bytes(versions[0])
    for number in range(20):
        child = os.fork()
        if child == 0:
            while True:
                atomic.write_by_rename(str(path), versions[number % 2])
        time.sleep(0.002 + number * 0.001)
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
        assert path.read_bytes() in versions
    atomic.write_by_rename(str(path), b"last")
    assert [entry.name for entry in tmp_path.iterdir()] == ["file"]


def test_record_comes_and_goes_with_its_folder(tmp_path):
    folder = tmp_path / "a" / "records"
    first, second = Record("first", str(folder)), Record("second", str(folder))
    assert first.load() == {}
    first.save({"x": 1})
    second.save({"y": 2})
    assert first.load() == {"x": 1}
    first.save({})
    assert folder.is_dir()
    second.save({})
    assert not folder.exists()


def test_what_is_saved_already_is_not_written_again(tmp_path):
    kept = Record("kept", str(tmp_path))
    kept.save({"x": 1})
    before = os.stat(kept.path)
    leftover = tmp_path / "kept.json.rosfleet-new-1"
    leftover.touch()
    kept.save({"x": 1})
    after = os.stat(kept.path)
    assert (after.st_ino, after.st_mtime_ns) == (before.st_ino, before.st_mtime_ns) and not leftover.exists()
    kept.save({"x": 2})
    assert kept.load() == {"x": 2}
    kept.save({})
    assert not tmp_path.exists()


def test_nothing_to_save_and_nothing_saved_touches_no_disk(tmp_path, monkeypatch):
    """A robot with a read-only root: nothing is ours there, and nothing has to be written."""

    def read_only(path):
        raise OSError(errno.EROFS, "Read-only file system", path)

    monkeypatch.setattr(os, "rmdir", read_only)
    monkeypatch.setattr(os, "unlink", read_only)
    Record("none", str(tmp_path / "absent")).save({})
    Record("none", str(tmp_path)).save({})  # an empty folder that cannot be removed is no failure
    monkeypatch.undo()
    Record("none", str(tmp_path)).save({})
    assert not tmp_path.exists()


@pytest.mark.parametrize("content", [b"{", b"[1]", b"\xff"])
def test_a_broken_record_is_a_sentence(tmp_path, content):
    (tmp_path / "broken.json").write_bytes(content)
    with pytest.raises(Problem, match="broken.json"):
        Record("broken", str(tmp_path)).load()


def test_make_folders_ends_for_a_relative_path(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert atomic.make_folders("a/b") == ["a", "a/b"]


def test_make_folders_leaves_none_where_one_fails(tmp_path):
    (tmp_path / "before").mkdir()
    with pytest.raises(OSError, match="too long"):
        atomic.make_folders(str(tmp_path / "before" / "a" / "b" / ("long" * 100)))
    assert list((tmp_path / "before").iterdir()) == []


def test_make_folders_tells_what_it_made(tmp_path):
    assert atomic.make_folders(str(tmp_path / "a" / "b")) == [str(tmp_path / "a"), str(tmp_path / "a" / "b")]
    assert atomic.make_folders(str(tmp_path / "a" / "b")) == []
    atomic.remove_folder_if_empty(str(tmp_path / "a"))
    assert (tmp_path / "a" / "b").is_dir()
    for _again in range(2):
        atomic.remove_folder_if_empty(str(tmp_path / "a" / "b"))
        assert not (tmp_path / "a" / "b").exists()


def test_the_names_of_the_records(tmp_path):
    assert record.records(str(tmp_path / "none")) == []
    Record("sysctl", str(tmp_path)).save({"a": 1})
    Record("files-nodes", str(tmp_path)).save({"a": 1})
    assert record.records(str(tmp_path)) == ["files-nodes", "sysctl"]


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b'{"files": []}', "files is []"),
        (b'{"files": {"/a": {"written": 5}}}', "files./a.written is 5"),
        (b'{"folders": ["/a", null]}', "folders[1] is None"),
        (b'{"folders": "/a"}', "folders is '/a'"),
        (b'{"folders": ["/a\\u0000b"]}', "folders[0] is '/a\\x00b'"),
        (b'{"files": {"/\\ud800": {}}}', "a key of files is"),
        (b"[" * 100_000, "is not readable as JSON"),
        (b"\xff", "is not readable as JSON"),
        (b"[]", "holds no JSON object"),
    ],
)
def test_a_malformed_record_gives_one_sentence(tmp_path, content, words):
    found = Record("x", str(tmp_path), {"files": {"*": {"*": str}}, "folders": [str]})
    (tmp_path / "x.json").write_bytes(content)
    with pytest.raises(Problem, match="The record .*/x.json ") as caught:
        found.load()
    assert words in str(caught.value)


def test_a_pipe_in_the_place_of_a_record_is_named(tmp_path):
    os.mkfifo(str(tmp_path / "x.json"))
    with pytest.raises(Problem, match="Is a pipe"):
        Record("x", str(tmp_path)).load()
