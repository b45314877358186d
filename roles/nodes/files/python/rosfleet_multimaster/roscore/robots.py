# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The robot that has the computer at an address, by the file with the parameters of master_discovery.

It is read again when it has changed: a robot that is added restarts no roscore. Without it, each address is a robot.
"""

import json
import logging
import os
from typing import Any, Callable, Collection, Tuple

from ..protocol.members import NOBODIES, Members
from ..protocol.plain_text import plain

_log = logging.getLogger("rosfleet.robots")

EVERY = 5.0  # seconds between two looks at the file
_LARGEST = 4 << 20  # bytes; 1,000 robots are 500 kB


class Robots:
    """The robots of the fleet. `at` is asked in threads."""

    def __init__(self, path: str, report: Callable[[Collection[str]], None]) -> None:
        """`path`: of the file; "" without a file. `report(robots)` is called after each change, with the robots and the names of those that are no robot."""
        self._path, self._members, self._report = path, Members(), report
        self._due, self._state = 0.0, (0, 0, 0)

    def at(self, address: str) -> str:
        """The robot at an address, as of Members.robot_at."""
        return self._members.robot_at(address)

    def look(self, now: float) -> None:
        """Read the file if it has changed. One that cannot be read changes nothing."""
        if not self._path or now < self._due:
            return
        self._due = now + EVERY
        try:
            found = os.stat(self._path)
            state: Tuple[int, int, int] = (found.st_ino, found.st_mtime_ns, found.st_size)
            if state == self._state or found.st_size > _LARGEST:
                return
            with open(self._path, encoding="utf-8") as file:
                values: Any = json.load(file)
            self._members, self._state = Members.from_parameters(values), state
            self._report({*NOBODIES, *(member.robot for member in self._members.robots)})
        except FileNotFoundError:
            pass
        except Exception as problem:  # root's file, which a person may have edited
            _log.warning("the robots cannot be read: %s", plain(problem))
