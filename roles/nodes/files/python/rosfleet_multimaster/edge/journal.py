# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The lines that a program writes for the journal, or for a terminal. No foreign text can break or colour them.

There are three ways out, and all are here: the log (ours and that of rospy, by logging.conf), the sentences of our small
programs, and the standard streams, to which rospy prints foreign text, such as the reason of a `shutdown`. Each line begins
with a priority and a word of ours, so journald takes no foreign `<0>` for one. The output of other programs comes by
children.py to the first two.
"""

import logging
import os
import sys
import threading
import traceback
from typing import Any, List, Optional, TextIO

from ..protocol.plain_text import LINE, plain, plain_lines

_PRIORITIES = {logging.DEBUG: 7, logging.INFO: 6, logging.WARNING: 4, logging.ERROR: 3, logging.CRITICAL: 2}
_TRACEBACK = 60  # lines of one


class Format(logging.Formatter):
    """Lines for the journal, which reads the priority from `<N>`; plain lines for a terminal."""

    def format(self, record: logging.LogRecord) -> str:
        """The lines of a record: its message is one of them, whatever is in it."""
        try:
            message = record.getMessage()
        except Exception as problem:  # rospy's log has lines whose arguments do not fit
            message = f"{record.msg} ({problem})"
        name = "" if record.name.split(".")[0] == "rosfleet" else f"{record.name}: "
        lines = [plain(name + message, LINE), *_traceback(record.exc_info)]
        return "\n".join([_line(record.levelno, lines[0]), *(_line(record.levelno, line, "") for line in lines[1:])])


def _line(level: int, text: str, name: Optional[str] = None) -> str:
    """A line with its beginning: its priority for the journal, the `name` of its level for a terminal."""
    if "JOURNAL_STREAM" in os.environ:
        return f"<{_PRIORITIES.get(level, 6)}>{text}"
    return (f"{logging.getLevelName(level)}: " if name is None else name) + text


def _traceback(info: Any) -> List[str]:
    """The lines of an exception; its text is the last of them."""
    if not info or info[1] is None:
        return []
    frames = [line for frame in traceback.format_tb(info[2]) for line in frame.splitlines()][-_TRACEBACK:]
    return [*(plain_lines(line) for line in frames), plain(f"{type(info[1]).__name__}: {info[1]}", LINE)]


class LineHandler(logging.StreamHandler):  # type: ignore[type-arg]  # a class of Python 3.8 takes no argument
    """Writes the lines of a record one by one: to the stream, several in one piece are one line."""

    def __init__(self, stream: Any = None) -> None:
        super().__init__(_unwrap(stream or sys.stderr))

    def emit(self, record: logging.LogRecord) -> None:
        """Write a record."""
        try:
            for line in self.format(record).split("\n"):
                self.stream.write(line + "\n")
            self.flush()
        except Exception:  # as logging does it
            self.handleError(record)


def quiet(*names: str) -> None:
    """Drop the log lines of these libraries: each line is about one request, and its caller has it as the answer."""
    for name in names:
        logger = logging.getLogger(name)
        logger.addHandler(logging.NullHandler())
        logger.propagate = False


class RospyHandler(LineHandler):
    """The same in a node that is not a bundled one (logging.conf): the output of its rospy is plain, too."""

    def __init__(self, stream: Any = None) -> None:
        super().__init__(stream)
        plain_streams()


def say(text: str, level: int = logging.WARNING) -> None:
    """Write a sentence of a program that has no log."""
    stream = _unwrap(sys.stderr)
    stream.write(_line(level, plain(text, LINE), "") + "\n")
    stream.flush()


class PlainStream:
    """A text stream to which each piece is written on one line. Its other methods are those of the stream behind it.

    Pieces of a line wait for its end, for each thread on its own, so that each line begins with words of ours.
    """

    def __init__(self, stream: TextIO, level: int = logging.INFO) -> None:
        self.stream, self._level = stream, level
        self._piece = threading.local()

    def write(self, text: str) -> int:
        """Write a piece: a line break counts at its end only."""
        self._piece.text = getattr(self._piece, "text", "") + text[: 2 * LINE]
        if text.endswith("\n") or len(self._piece.text) > LINE:
            self._end_line()
        return len(text)

    def writelines(self, lines: Any) -> None:
        """Write pieces."""
        for line in lines:
            self.write(line)

    def flush(self) -> None:
        """Write the waiting lines."""
        self._end_line()
        self.stream.flush()

    def _end_line(self) -> None:
        text, self._piece.text = getattr(self._piece, "text", ""), ""
        if text.strip():
            self.stream.write(_line(self._level, plain(f"printed: {text}", LINE), "") + "\n")

    def __getattr__(self, name: str) -> Any:
        return getattr(self.stream, name)


def _unwrap(stream: Any) -> Any:
    return stream.stream if isinstance(stream, PlainStream) else stream


def plain_streams() -> None:
    """Make all later output plain text."""
    for name, level in (("stdout", logging.INFO), ("stderr", logging.WARNING)):
        stream: Optional[Any] = getattr(sys, name)
        if stream is not None and not isinstance(stream, PlainStream):
            setattr(sys, name, PlainStream(stream, level))
