# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Copies for node_exporter, and refusals: the files are those of nodes that strangers talk with."""

import os
import signal
import subprocess
import sys
import time

import pytest
from processes import with_paths
from rosfleet_multimaster.publish_metrics import MOST, Publisher

TEXT = "# HELP a b\n# TYPE a gauge\na 1\n"


@pytest.fixture(name="place")
def _place(tmp_path):
    """The folder, the file of a node, and its copy."""
    folder = tmp_path / "folder"
    folder.mkdir()
    return Publisher(str(folder), {"a.prom": str(tmp_path / "source")}), tmp_path / "source", folder / "a.prom"


def test_a_file_is_copied_whole_and_goes_with_its_source(place):
    publisher, source, copy = place
    publisher.look()
    assert not copy.exists()
    source.write_text(TEXT)
    os.umask(os.umask(0o077))
    publisher.look()
    assert copy.read_text() == TEXT and copy.stat().st_mode & 0o777 == 0o644
    source.unlink()
    publisher.look()
    assert list(copy.parent.iterdir()) == []


def test_what_did_not_change_is_not_written_again(place):
    publisher, source, copy = place
    source.write_text(TEXT)
    publisher.look()
    first = copy.stat().st_ino
    publisher.look()
    assert copy.stat().st_ino == first
    source.write_text(TEXT + TEXT)
    publisher.look()
    assert copy.stat().st_ino != first and copy.read_text() == TEXT + TEXT


def _link(source):
    (source.parent / "secret").write_text("secret\n")
    source.symlink_to(source.parent / "secret")


@pytest.mark.parametrize(
    "make",
    [
        _link,
        lambda source: os.mkfifo(str(source)),
        lambda source: source.mkdir(),
        lambda source: source.write_text("x" * (MOST + 1)),
        lambda source: source.write_bytes(b"\xff\xfe"),
        lambda source: source.write_text(""),
        lambda source: source.symlink_to("/dev/zero"),
    ],
    ids=["link", "fifo", "folder", "large", "no text", "empty", "endless"],
)
def test_a_file_without_metrics_is_not_copied(place, make):
    publisher, source, copy = place
    source.write_text(TEXT)
    publisher.look()
    source.unlink()
    make(source)
    publisher.look()
    assert not copy.exists()


def test_a_folder_that_is_gone_is_told(place):
    publisher, source, copy = place
    source.write_text(TEXT)
    copy.parent.rmdir()
    with pytest.raises(OSError, match="folder"):
        publisher.look()


def test_files_of_others_stay_and_sigterm_removes_ours(tmp_path):
    folder = tmp_path / "folder"
    folder.mkdir()
    (folder / "other.prom").write_text(TEXT)
    (folder / "multimaster_sync.prom").write_text("old\n")  # of a run that was killed
    code = "from rosfleet_multimaster import publish_metrics; publish_metrics.main(__import__('sys').argv[1])"
    with subprocess.Popen([sys.executable, "-c", code, str(folder)], env=with_paths()) as process:
        try:
            for _try in range(200):
                if not (folder / "multimaster_sync.prom").exists():
                    break
                time.sleep(0.05)
        finally:
            process.send_signal(signal.SIGTERM)
        assert process.wait(20) == 0
    assert [path.name for path in folder.iterdir()] == ["other.prom"]
