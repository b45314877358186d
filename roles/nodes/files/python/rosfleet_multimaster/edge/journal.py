# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""What the program writes: lines for the journal, or for a terminal, that nobody else's text can break or colour.

There are two ways out, and both are here: the log (ours and that of rospy, by logging.conf), and the standard streams, to
which rospy prints what others say, such as the reason of a `shutdown`.
"""

import logging
import os
import sys
import traceback
from typing import Any, List, Optional, TextIO

from ..core.plain_text import LINE, plain, plain_lines

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
        if "JOURNAL_STREAM" not in os.environ:
            return "\n".join([f"{record.levelname}: {lines[0]}", *lines[1:]])
        return "\n".join(f"<{_PRIORITIES.get(record.levelno, 6)}>{line}" for line in lines)


def _traceback(info: Any) -> List[str]:
    """The lines of an exception; its text is the last of them."""
    if not info or info[1] is None:
        return []
    frames = [line for frame in traceback.format_tb(info[2]) for line in frame.splitlines()][-_TRACEBACK:]
    return [*(plain_lines(line) for line in frames), plain(f"{type(info[1]).__name__}: {info[1]}", LINE)]


class Handler(logging.StreamHandler):  # type: ignore[type-arg]  # a class of Python 3.8 takes no argument
    """Writes the lines of a record one by one: to the stream, several in one piece are one line."""

    def emit(self, record: logging.LogRecord) -> None:
        """Write a record."""
        try:
            for line in self.format(record).split("\n"):
                self.stream.write(line + "\n")
            self.flush()
        except Exception:  # as logging does it
            self.handleError(record)


def quiet(*names: str) -> None:
    """Say nothing of what these libraries log: each line is about one request of anybody, who has it as the answer."""
    for name in names:
        logger = logging.getLogger(name)
        logger.addHandler(logging.NullHandler())
        logger.propagate = False


class PlainStream:
    """A text stream to which each piece is written on one line. Its other methods are those of the stream behind it."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream

    def write(self, text: str) -> int:
        """Write a piece: a line break counts at its end only."""
        body, end = (text[:-1], "\n") if text.endswith("\n") else (text, "")
        self._stream.write(plain_lines(body.replace("\n", " ")) + end)
        return len(text)

    def writelines(self, lines: Any) -> None:
        """Write pieces."""
        for line in lines:
            self.write(line)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


def plain_streams() -> None:
    """From now on, what anybody prints is plain."""
    for name in ("stdout", "stderr"):
        stream: Optional[Any] = getattr(sys, name)
        if stream is not None and not isinstance(stream, PlainStream):
            setattr(sys, name, PlainStream(stream))
