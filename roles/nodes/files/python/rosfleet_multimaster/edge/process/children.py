# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Other programs of this computer: one that runs with this one, and short ones whose output is wanted.

Their output may be hostile text: rosout prints the reason of a `shutdown`. So no program is given the standard streams of
this one. Its own output is handed on line by line, or goes nowhere.
"""

import os
import re
import subprocess
import threading
from typing import IO, Callable, Iterator, List, Optional, Sequence

_PIECE = 8192  # bytes of a line; the rest of it is left out
_DRAINED = 1.0  # seconds for the last lines of a program that has ended
_COLOUR = re.compile(rb"\x1b\[[0-9;]*m")


class Child:
    """A program that is started again when it has ended."""

    def __init__(self, on_line: Callable[[str], None]) -> None:
        """`on_line(line)`: it has written this; called in a thread, the line is still as it was written."""
        self._process: Optional[subprocess.Popen[bytes]] = None
        self._on_line = on_line
        self._reader: Optional[threading.Thread] = None

    def runs(self) -> bool:
        """True if it is there."""
        return self._process is not None and self._process.poll() is None

    def start(self, command: Sequence[str]) -> None:
        """Start it. Raises OSError."""
        self._process = subprocess.Popen(
            list(command),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            cwd="/",
        )
        self._reader = threading.Thread(target=self._hand_on, args=(self._process.stdout,), daemon=True)
        self._reader.start()

    def wait(self) -> int:
        """Wait for its end, and for its last lines; the exit status, that of a signal is negative."""
        status = self._process.wait() if self._process is not None else 0
        if self._reader is not None:
            self._reader.join(_DRAINED)  # a process that it has left behind may hold the pipe
        return status

    def _hand_on(self, stream: IO[bytes]) -> None:
        with stream:
            for line in _lines(stream):
                self._on_line(line)

    def end(self, seconds: float) -> None:
        """End it, and wait."""
        if self._process is not None and self.runs():
            self._process.terminate()
            try:
                self._process.wait(seconds)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()


def _lines(stream: IO[bytes]) -> Iterator[str]:
    """The lines that are not empty, each without its rest beyond the limit, and without colours."""
    begun = True
    while True:
        piece = stream.readline(_PIECE)
        if not piece:
            return
        text = _COLOUR.sub(b"", piece).decode("utf-8", "replace").strip()
        if begun and text:
            yield text
        begun = piece.endswith(b"\n")


def output(command: Sequence[str], seconds: float) -> str:
    """The output of a program, "" if it fails."""
    try:
        text = subprocess.check_output(
            list(command), stdin=subprocess.DEVNULL, stderr=subprocess.DEVNULL, timeout=seconds
        )
    except (OSError, subprocess.SubprocessError):
        return ""
    return text.decode("utf-8", "replace")


def node_path(package: str, program: str) -> List[str]:
    """The command that starts a node: its file below a prefix of ROS, or by rosrun."""
    prefixes = [*os.environ.get("CMAKE_PREFIX_PATH", "").split(":"), "/usr"]
    for prefix in prefixes:
        path = os.path.join(prefix, "lib", package, program)
        if prefix.startswith("/") and os.access(path, os.X_OK):
            return [path]
    return ["rosrun", package, program]
