# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The readers of a process's environment and of its start."""

import os
import subprocess
import time

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._base import processes


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


def test_the_start_of_a_process_by_the_clock_of_now(tmp_path):
    before = time.time()
    with subprocess.Popen(["sleep", "9"]) as process:
        began = processes.start_time(process.pid)
        process.kill()
    assert before - 0.1 <= began <= time.time() + 0.1
    assert processes.start_time(process.pid) is None
    (tmp_path / "7").mkdir()
    (tmp_path / "7" / "stat").write_text(f"7 (a ) b) S {' '.join(['0'] * 18)} 5000 0")
    (tmp_path / "uptime").write_text("100.25 7.00\n")
    ago = 100.25 - 5000 / os.sysconf("SC_CLK_TCK")
    assert processes.start_time(7, str(tmp_path)) == pytest.approx(time.time() - ago, abs=1.0)


@pytest.mark.parametrize("uptime", [None, ""])
def test_without_an_uptime_the_start_is_unknown(tmp_path, uptime):
    (tmp_path / "7").mkdir()
    (tmp_path / "7" / "stat").write_text(f"7 (a) S {' '.join(['0'] * 18)} 5000 0")
    if uptime is not None:
        (tmp_path / "uptime").write_text(uptime)
    assert processes.start_time(7, str(tmp_path)) is None


@pytest.mark.parametrize("stat", ["", "7 (a", "7 (a)", "7 (a) T 1", f"7 (a) T {' '.join(['0'] * 18)} 50"])
def test_a_stat_that_is_cut_off_is_that_of_no_process(tmp_path, monkeypatch, stat):
    (tmp_path / "7").mkdir()
    (tmp_path / "7" / "stat").write_text(stat)
    (tmp_path / "uptime").write_text("100.25 7.00\n")
    monkeypatch.setattr(processes.os, "getppid", lambda: 7)
    assert list(processes.ancestors(str(tmp_path))) == []
    assert processes.start_time(7, str(tmp_path)) is None
    assert not processes.is_stopped(7, str(tmp_path))
