# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Other programs of this computer: one that runs beside this one, and short ones whose output is wanted."""

import os
import subprocess
from typing import List, Optional, Sequence


class Child:
    """A program that is started again when it has ended."""

    def __init__(self) -> None:
        self._process: Optional[subprocess.Popen[bytes]] = None

    def runs(self) -> bool:
        """True where it is there."""
        return self._process is not None and self._process.poll() is None

    def start(self, command: Sequence[str]) -> None:
        """Start it. Raises OSError."""
        self._process = subprocess.Popen(list(command), stdin=subprocess.DEVNULL, cwd="/")

    def end(self, seconds: float) -> None:
        """End it, and wait."""
        if self._process is not None and self.runs():
            self._process.terminate()
            try:
                self._process.wait(seconds)
            except subprocess.TimeoutExpired:
                self._process.kill()


def output(command: Sequence[str], seconds: float) -> str:
    """The output of a program, "" where it fails."""
    try:
        done = subprocess.run(
            list(command),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            timeout=seconds,
            check=False,
        )
    except (OSError, subprocess.SubprocessError):
        return ""
    return done.stdout.decode("utf-8", "replace") if done.returncode == 0 else ""


def node_path(package: str, program: str) -> List[str]:
    """The command that starts a node: its file below a prefix of ROS, or by rosrun."""
    prefixes = [*os.environ.get("CMAKE_PREFIX_PATH", "").split(":"), "/usr"]
    for prefix in prefixes:
        path = os.path.join(prefix, "lib", package, program)
        if prefix.startswith("/") and os.access(path, os.X_OK):
            return [path]
    return ["rosrun", package, program]
