# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The parts of `roscore` besides rosmaster: the parameters that roslaunch reads, and the node rosout."""

import logging
import os
import re
import uuid
from typing import Any, Callable, Dict
from urllib.parse import urlsplit

from ..edge.process.children import Child, node_path, output

_log = logging.getLogger("rosfleet.roscore")

CALLER = "/roslaunch"
ROSOUT = "/rosout"
PATIENCE = 30.0  # seconds for rosversion
PAUSE, LONGEST = 1.0, 30.0  # seconds until rosout is started again, doubled up to

Call = Callable[..., Any]  # (method, arguments...) of the master


def set_run_id(call: Call) -> None:
    """Set /run_id, unless an earlier life has set it."""
    if not call("hasParam", CALLER, "/run_id")[2]:
        call("setParam", CALLER, "/run_id", str(uuid.uuid1()))


def set_uri(call: Call, uri: str) -> None:
    """Set the parameter that has the URI of this program, as roslaunch does."""
    parts = urlsplit(uri)
    host = re.sub("[^a-z0-9]", "_", (parts.hostname or "").lower())
    call("setParam", CALLER, f"/roslaunch/uris/host_{host}__{parts.port}", uri)


def set_versions(call: Call) -> None:
    """Set /rosversion and /rosdistro. It takes a second, so it runs in a thread."""
    for name, command in (("/rosversion", ["rosversion", "roslaunch"]), ("/rosdistro", ["rosversion", "-d"])):
        value = output(command, PATIENCE)
        if value and call("getParam", CALLER, name)[2] != value:
            call("setParam", CALLER, name, value)


class Rosout:
    """The node rosout: started while its name is free, and again when it has ended."""

    def __init__(self, lookup: Callable[[str], str]) -> None:
        """`lookup(name)`: the URI of a node, "" if no node has the name."""
        self._lookup, self._child = lookup, Child(lambda line: _log.info("rosout says: %s", line))
        self._due, self._pause, self._started = 0.0, PAUSE, 0
        self._missing = False

    def tick(self, now: float) -> float:
        """Start it if it is missing; the time of the next look."""
        if self._child.runs():
            self._pause = PAUSE
        elif now >= self._due and not self._lookup(ROSOUT):
            self._due, self._pause = now + self._pause, min(2 * self._pause, LONGEST)
            self._start()
        return now + 0.1 if not self._started else now + 1.0

    def _start(self) -> None:
        self._started += 1
        try:
            self._child.start([*node_path("rosout", "rosout"), "__name:=rosout"])
        except OSError as problem:
            if not self._missing:
                _log.warning("rosout cannot be started: %s", problem)
            self._missing = True

    def processes(self) -> Any:
        """The processes, in the words of roslaunch."""
        own = [["rosout-1", max(self._started - 1, 0)]]
        return [1, "processes on parent machine", [own, []] if self._child.runs() else [[], own]]

    def end(self) -> None:
        """End it."""
        self._child.end(1.0)


def roslaunch_methods(rosout: Rosout) -> Dict[str, Callable[..., Any]]:
    """The methods of the XML-RPC server that `roscore` has as a roslaunch: tools list its processes."""
    return {
        "list_processes": rosout.processes,
        "get_pid": lambda: [1, "", os.getpid()],
        "get_node_names": lambda: [1, "node names", [ROSOUT]],
    }
