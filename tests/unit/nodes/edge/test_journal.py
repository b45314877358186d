# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""What the nodes write: one record is one line, whatever is in it; what is printed is plain."""

import io
import logging
import logging.config
import pathlib
import sys

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rosfleet_multimaster.core.plain_text import is_plain
from rosfleet_multimaster.edge import journal

CONFIG = pathlib.Path(journal.__file__).parents[1] / "logging.conf"
FORGED = "gone\n<0>rosfleet: all is well\u2028\x85\x1b[2J\u202e"


def record(text, *arguments, exc_info=None, name="rosfleet"):
    return logging.LogRecord(name, logging.WARNING, __file__, 1, text, arguments, exc_info)


def failure(text):
    try:
        raise ValueError(text)
    except ValueError:
        return sys.exc_info()


@pytest.mark.parametrize("journal_stream", ["1:2", ""])
def test_a_record_is_one_line(monkeypatch, journal_stream):
    if journal_stream:
        monkeypatch.setenv("JOURNAL_STREAM", journal_stream)
    else:
        monkeypatch.delenv("JOURNAL_STREAM", raising=False)
    line = journal.Format().format(record("a reason: %s", FORGED))
    assert is_plain(line)
    assert line.startswith("<4>a reason: gone <0>rosfleet" if journal_stream else "WARNING: a reason: gone <0>")


@given(st.text(st.characters(), max_size=300))
def test_the_text_of_an_exception_is_the_last_line_of_its_traceback(text):
    lines = journal.Format().format(record("it broke", exc_info=failure(text))).split("\n")
    assert all(map(is_plain, lines))
    assert lines[-1].endswith("...") or "ValueError:" in lines[-1]
    assert len(lines) == 4  # the message, two of the frame, the exception


def test_arguments_that_do_not_fit_are_no_reason_to_fail():
    assert "two %s %s" in journal.Format().format(record("two %s %s", "one"))


@given(st.text(st.characters(), max_size=300))
def test_what_is_printed_is_plain(text):
    behind = io.StringIO(newline="")
    stream = journal.PlainStream(behind)
    print(f"shutdown request: {text}", file=stream)
    lines = behind.getvalue().split("\n")
    assert all(is_plain(line.replace("\t", " ")) for line in lines)
    assert not any(lines[1:]), "nothing stands on a second line"


def test_pieces_of_a_line_stay_together():
    behind = io.StringIO()
    stream = journal.PlainStream(behind)
    stream.writelines(["one ", "line\n"])
    stream.flush()
    assert behind.getvalue() == "one line\n"


def test_streams_are_made_plain_once(monkeypatch):
    for name in ("stdout", "stderr"):
        monkeypatch.setattr(sys, name, io.StringIO())
    journal.plain_streams()
    before = sys.stdout
    journal.plain_streams()
    assert sys.stdout is before
    print(FORGED)
    assert sys.stdout.getvalue().count("\n") == 1


def test_the_lines_of_rospy_are_plain_too(monkeypatch):
    monkeypatch.setattr(sys, "stderr", io.StringIO())
    root, before = logging.getLogger(), (logging.getLogger().handlers[:], logging.getLogger().level)
    try:
        logging.config.fileConfig(str(CONFIG), disable_existing_loggers=False)
        logging.getLogger("rospy.internal").warning("shut down: %s", FORGED)
    finally:
        root.handlers[:], root.level = before
    assert sys.stderr.getvalue().count("\n") == 1
    assert "rospy.internal: shut down: gone" in sys.stderr.getvalue()
