# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Other programs: one that is started again, and short ones."""

import os
import signal
import sys
import time

import pytest
from rosfleet_multimaster.edge.process import children as module
from running_sync import until

SLEEPS = [sys.executable, "-c", "import time; time.sleep(60)"]
DEAF = [
    sys.executable,
    "-c",
    "import signal, time; signal.signal(15, signal.SIG_IGN); print('deaf', flush=True); time.sleep(60)",
]


def test_a_program_runs_until_it_is_ended_and_can_start_again():
    child = module.Child(print)
    assert not child.runs()
    child.end(1.0)  # nothing to end
    for _life in range(2):
        child.start(SLEEPS)
        assert child.runs()
        child.end(5.0)
        assert not child.runs()


def test_a_program_that_ends_by_itself_runs_no_more():
    child = module.Child(print)
    child.start([sys.executable, "-c", ""])
    until = time.monotonic() + 10
    while child.runs() and time.monotonic() < until:
        time.sleep(0.01)
    assert not child.runs()


def test_a_program_that_does_not_want_to_end_is_killed():
    lines = []
    child = module.Child(lines.append)
    child.start(DEAF)
    until(lambda: lines == ["deaf"])
    child.end(0.2)
    assert child._process.returncode == -signal.SIGKILL, "it is no zombie"


FORGES = r"""
import os, sys
os.write(1, b"shut down: \x1b[31mgone\x1b[0m\n<0>rosfleet: all is well\n" + b"x" * 100000 + b"\n\n\xff\n")
os.write(2, "last \u202e word".encode())
sys.exit(3)
"""


def test_a_programs_output_is_handed_on_line_by_line(capfd):
    lines = []
    child = module.Child(lines.append)
    child.start([sys.executable, "-c", FORGES])
    assert child.wait() == 3
    assert lines == ["shut down: gone", "<0>rosfleet: all is well", "x" * 8192, "\ufffd", "last \u202e word"]
    assert capfd.readouterr() == ("", "")


def test_a_program_that_leaves_a_child_behind_is_not_waited_for():
    child = module.Child(print)
    child.start(["/bin/sh", "-c", "sleep 5 & echo here"])
    began = time.monotonic()
    assert child.wait() == 0
    assert time.monotonic() - began < 4


def test_a_program_that_is_not_there_is_an_error():
    with pytest.raises(OSError):
        module.Child(print).start(["/nowhere/program"])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("program", "text"),
    [
        ("print('noetic')", "noetic\n"),
        ("import sys; sys.stdout.buffer.write(b'\\xff')", "\ufffd"),
        ("print('half'); raise SystemExit(1)", ""),
        ("import time; time.sleep(60)", ""),
    ],
    ids=["an answer", "no text", "it fails", "it hangs"],
)
def test_the_output_of_a_short_program(program, text):
    began = time.monotonic()
    assert module.output([sys.executable, "-c", program], 2.0 if "sleep" in program else 20.0) == text
    assert time.monotonic() - began < 15


def test_no_output_of_a_program_that_is_not_there():
    assert module.output(["/nowhere/program"], 1.0) == ""


def test_a_node_starts_from_the_first_prefix_or_by_rosrun(tmp_path, monkeypatch):
    for prefix in ("one", "two", "three"):
        folder = tmp_path / prefix / "lib" / "example"
        folder.mkdir(parents=True)
        (folder / "node").write_text("")
        os.chmod(folder / "node", 0o644 if prefix == "one" else 0o755)
    monkeypatch.setenv("CMAKE_PREFIX_PATH", f"relative:{tmp_path / 'one'}:{tmp_path / 'two'}:{tmp_path / 'three'}")
    assert module.node_path("example", "node") == [str(tmp_path / "two/lib/example/node")]
    monkeypatch.delenv("CMAKE_PREFIX_PATH")
    assert module.node_path("no_such_package", "node") == ["rosrun", "no_such_package", "node"]
