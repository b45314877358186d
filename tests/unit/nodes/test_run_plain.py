# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""A program of others below ours, as a unit starts it: each line that it prints is one of ours, and it ends as it would alone."""

import os
import pathlib
import signal
import subprocess
import sys
import time

import pytest

FOLDER = pathlib.Path(__file__).parents[3] / "roles/nodes/files/python"
#: It prints, and so does a program of its own; then it waits for a signal.
PROGRAM = r"""
import os, signal, subprocess, sys, time
signal.signal(signal.SIGTERM, lambda *_about: (print("bye\n<0>forged", flush=True), sys.exit(7)))
print("it says\n<0>forged\r\n\x1b[2J", file=sys.stderr, flush=True)
subprocess.run(["/bin/sh", "-c", "echo '<1>of its own program'"])
print("ready", flush=True)
time.sleep(60)
"""


@pytest.fixture(name="start")
def fixture_start():
    """Start a program below ours, in a group of its own, as if the journal read it."""
    started = []

    def start(*command):
        environment = {**os.environ, "PYTHONPATH": str(FOLDER), "PYTHONDONTWRITEBYTECODE": "1", "JOURNAL_STREAM": "1:2"}
        argv = [sys.executable, "-m", "rosfleet_multimaster.run_plain", *command]
        process = subprocess.Popen(argv, env=environment, stderr=subprocess.PIPE, text=True, start_new_session=True)
        started.append(process)
        return process

    yield start
    for process in started:
        process.kill()
        process.wait()


def lines_until(process, end):
    lines = []
    for line in process.stderr:
        lines.append(line.rstrip("\n"))
        if end in line:
            break
    return lines


def test_each_line_is_ours_and_the_exit_code_the_programs(start):
    process = start(sys.executable, "-u", "-c", PROGRAM)
    name = f"<6>{os.path.basename(sys.executable)} says: "
    assert lines_until(process, "ready") == [
        *(f"{name}it says", f"{name}<0>forged", f"{name}\\x1b[2J"),
        *(f"{name}<1>of its own program", f"{name}ready"),
    ]
    os.killpg(process.pid, signal.SIGTERM)  # as systemd does it
    assert lines_until(process, "never") == [f"{name}bye", f"{name}<0>forged"]
    assert process.wait(10) == 7


def test_a_program_that_a_signal_ends_has_ended_by_it(start):
    process = start("/bin/sh", "-c", "echo there; exec sleep 60")
    lines_until(process, "there")
    time.sleep(0.1)
    os.killpg(process.pid, signal.SIGTERM)
    assert process.wait(10) == -signal.SIGTERM


def test_a_program_that_is_not_there_is_a_sentence(start):
    process = start("/nowhere/roscore", "-p", "1")
    assert process.wait(10) == 1
    assert process.stderr.read().startswith("<3>/nowhere/roscore cannot be started: ")
