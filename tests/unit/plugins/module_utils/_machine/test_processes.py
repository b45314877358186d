# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The reader of a process's environment."""

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine import processes


def test_entries_end_with_a_zero_byte():
    content = b"ROS_MASTER_URI=http://old:11311\0OPTIONS=a=b\0broken\0EMPTY=\0NAME=\xff\0"
    assert processes.parse(content) == {
        "ROS_MASTER_URI": "http://old:11311",
        "OPTIONS": "a=b",
        "EMPTY": "",
        "NAME": "\udcff",
    }


def test_a_process_is_read_below_proc(tmp_path):
    folder = tmp_path / "7"
    folder.mkdir()
    (folder / "environ").write_bytes(b"A=1\0")
    assert processes.environment("7", str(tmp_path)) == {"A": "1"}


def test_a_process_that_has_ended_is_an_error(tmp_path):
    with pytest.raises(OSError):
        processes.environment(7, str(tmp_path))
