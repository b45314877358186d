# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Files that are read: nothing that stands in their place makes a module hang or fills its memory."""

import os
import socket

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._base.commands import text
from ansible_collections.rosfleet.multimaster.plugins.module_utils._base.deadlines import call_within
from ansible_collections.rosfleet.multimaster.plugins.module_utils._base.regular_files import read_regular
from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine.fkie import packages


def test_a_regular_file_is_read_whole_or_its_beginning(tmp_path):
    path = tmp_path / "file"
    path.write_bytes(b"abcdef")
    assert read_regular(str(path)) == b"abcdef"
    assert read_regular(str(path), 3) == b"abc"
    assert read_regular("/proc/self/stat")


def test_a_special_or_huge_file_is_refused_at_once(tmp_path):
    os.mkfifo(str(tmp_path / "pipe"))
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(str(tmp_path / "socket"))
        with (tmp_path / "huge").open("wb") as stream:
            stream.truncate(1 << 40)
        for path, words in (
            (tmp_path / "pipe", "Is a pipe"),
            (tmp_path / "socket", "Is a socket"),
            (tmp_path, "Is a directory"),
            (tmp_path / "huge", "Is larger than 64 MiB"),
            ("/dev/zero", "Is a device"),
        ):
            with pytest.raises(OSError, match=words) as caught:
                call_within(5.0, read_regular, str(path))
            assert caught.value.filename == str(path)
            assert path == tmp_path / "huge" or text(str(path)) == ""
    assert text(str(tmp_path / "huge"), 10) == "\0" * 10


def test_a_pipe_in_the_place_of_the_package_list_does_not_hang(tmp_path):
    os.mkfifo(str(tmp_path / "packages"))
    with pytest.raises(OSError, match="Is a pipe"):  # and not a list in which nothing is ours
        call_within(5.0, packages, [], str(tmp_path / "packages"))
