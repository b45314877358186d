# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Run a foreign program, and write its output and that of its own programs as plain lines of the journal.

    python3 -m rosfleet_multimaster.run_plain /usr/bin/roscore -p 11311

The roscore of ROS brings rosmaster and rosout, and they print text of strangers, such as the reason of a `shutdown`. A signal for
the unit reaches all of its processes; this one waits for the end of the program, and ends as it does. It needs Python 3.6 and
no ROS.
"""

import logging
import os
import signal
import sys
from typing import Sequence

from .edge.journal import plain_streams, say
from .edge.process.children import Child


def main(command: Sequence[str]) -> int:
    """Run it, and return the exit status."""
    plain_streams()
    for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
        signal.signal(number, lambda *_about: None)  # a function: the program would inherit an ignored signal
    name = os.path.basename(command[0])
    child = Child(lambda line: say(f"{name} says: {line}", logging.INFO))
    try:
        child.start(command)
    except OSError as problem:
        say(f"{command[0]} cannot be started: {problem}", logging.ERROR)
        return 1
    status = child.wait()
    if status < 0:
        _end_by(-status)
    return status


def _end_by(number: int) -> None:
    """End by the signal that has ended the program: systemd takes some for a good end."""
    if number != signal.SIGKILL:
        signal.signal(number, signal.SIG_DFL)
    os.kill(os.getpid(), number)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
