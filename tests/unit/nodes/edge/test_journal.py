# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The journal of the nodes: one record is one line, whatever is in it; each print is plain."""

import io
import logging
import logging.config
import pathlib
import sys
import threading
import traceback

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rosfleet_multimaster.edge import journal
from rosfleet_multimaster.protocol.plain_text import is_plain

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
def test_an_exceptions_text_is_its_tracebacks_last_line(text):
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
    print("another", "one", file=stream)
    stream.write("half")
    assert behind.getvalue() == "printed: one line\nprinted: another one\n"
    stream.flush()
    assert behind.getvalue().endswith("\nprinted: half\n")


@pytest.mark.parametrize("journal_stream", ["1:2", ""])
@given(st.lists(st.one_of(st.text(st.characters(), max_size=50), st.just(FORGED), st.just("<0>forged\n")), max_size=6))
def test_each_printed_line_begins_with_words_of_ours(journal_stream, pieces):
    behind = io.StringIO(newline="")
    with pytest.MonkeyPatch.context() as patched:
        patched.setenv("JOURNAL_STREAM", journal_stream)
        if not journal_stream:
            patched.delenv("JOURNAL_STREAM")
        stream = journal.PlainStream(behind, logging.WARNING)
        for piece in pieces:
            stream.write(piece)
        print(*pieces, file=stream)
        print(*pieces, sep="\n", end="", file=stream)
        stream.flush()
    start = "<4>printed: " if journal_stream else "printed: "
    assert all(line.startswith(start) and is_plain(line) for line in behind.getvalue().split("\n")[:-1])


def test_pieces_of_two_threads_are_two_lines():
    behind = io.StringIO()
    stream = journal.PlainStream(behind)
    stream.write("one ")
    other = threading.Thread(target=print, args=("other",), kwargs={"file": stream})
    other.start()
    other.join()
    stream.write("line\n")
    assert behind.getvalue() == "printed: other\nprinted: one line\n"


def test_the_traceback_of_a_thread_begins_with_words_of_ours(monkeypatch):
    monkeypatch.setattr(sys, "stderr", io.StringIO())
    monkeypatch.setenv("JOURNAL_STREAM", "1:2")
    journal.plain_streams()
    output = sys.stderr.stream
    traceback.print_exception(*failure(FORGED))
    sys.__excepthook__(*failure(FORGED))
    lines = output.getvalue().split("\n")[:-1]
    assert len(lines) >= 6 and all(line.startswith("<4>printed: ") and is_plain(line) for line in lines)


def test_the_sentence_of_a_small_program_is_one_line(monkeypatch):
    monkeypatch.setattr(sys, "stderr", io.StringIO())
    monkeypatch.setenv("JOURNAL_STREAM", "1:2")
    journal.plain_streams()
    journal.say(f"it says {FORGED}")
    journal.say("good", logging.INFO)
    lines = sys.stderr.getvalue().split("\n")
    assert lines[0].startswith("<4>it says gone <0>rosfleet") and is_plain(lines[0]) and lines[1:] == ["<6>good", ""]


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
    for name in ("stdout", "stderr"):
        monkeypatch.setattr(sys, name, io.StringIO())
    root, before = logging.getLogger(), (logging.getLogger().handlers[:], logging.getLogger().level)
    try:
        logging.config.fileConfig(str(CONFIG), disable_existing_loggers=False)
        logging.getLogger("rospy.internal").warning("shut down: %s", FORGED)
        print(f"shutdown request: {FORGED}")
    finally:
        root.handlers[:], root.level = before
    assert (
        sys.stdout.getvalue().startswith("printed: shutdown request: gone <0>")
        and sys.stdout.getvalue().count("\n") == 1
    )
    assert sys.stderr.getvalue().count("\n") == 1
    assert "rospy.internal: shut down: gone" in sys.stderr.getvalue()
