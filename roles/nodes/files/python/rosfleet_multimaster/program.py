# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""What the two programs share: their arguments, their log, and the roscore that they belong to."""

import argparse
import json
import logging
import os
import signal
import sys
import time
import warnings
import xmlrpc.client
from typing import Any, Callable, Dict, List, Mapping, Optional, Tuple

from .core import parameters
from .edge.clock import monotonic
from .edge.loop import Loop
from .edge.roscore import Roscore
from .edge.rpc_client import Rpc
from .edge.systemd import notify

FAILURES = (OSError, ValueError, xmlrpc.client.Fault)  # what a call to another program may end with
IMPORTS = (
    "/rosfleet_multimaster/imports"  # parameter: what master_sync registered, for whom; lives as long as that does
)

_PRIORITIES = {logging.DEBUG: 7, logging.INFO: 6, logging.WARNING: 4, logging.ERROR: 3, logging.CRITICAL: 2}
_LEVELS = {"WARN": "WARNING", "FATAL": "CRITICAL"}
_EVERY = 60.0  # seconds between two lines about one thing
_LINES = 60  # limited lines in that time, whatever they are about


class Fatal(Exception):
    """The program ends with this sentence."""


class _Format(logging.Formatter):
    """Lines for the journal, which reads the priority from `<N>`; plain lines for a terminal."""

    def format(self, record: logging.LogRecord) -> str:
        text = super().format(record)
        if "JOURNAL_STREAM" not in os.environ:
            return f"{record.levelname}: {text}"
        return "\n".join(f"<{_PRIORITIES.get(record.levelno, 6)}>{line}" for line in text.splitlines())


def logger(level: str = "INFO") -> logging.Logger:
    """The log of the program, on standard error."""
    log = logging.getLogger("rosfleet")
    if not log.handlers:
        handler = logging.StreamHandler(sys.stderr)
        handler.setFormatter(_Format())
        log.addHandler(handler)
        log.propagate = False
    log.setLevel(_LEVELS.get(level, level))
    return log


class Limited:
    """A log that says one thing once a minute, and then how often it has not said it; and not too many things at all."""

    def __init__(self, log: logging.Logger) -> None:
        self._log = log
        self._said: Dict[str, Tuple[Optional[float], int]] = {}
        self._minute, self._lines, self._dropped = -_EVERY, 0, 0

    def say(self, level: str, topic: str, text: str) -> None:
        """Log a line, unless one of this topic was logged a short while ago, or very many of other ones."""
        now = monotonic()
        at, silent = self._said.get(topic, (None, 0))
        if at is not None and now - at < _EVERY:
            self._said[topic] = (at, silent + 1)
            return
        if now - self._minute >= _EVERY:
            if self._dropped:
                self._log.warning("%d more lines were not logged", self._dropped)
            self._minute, self._lines, self._dropped = now, 0, 0
        if self._lines >= _LINES:
            self._dropped += 1
            return
        if len(self._said) > 1000:
            self._said.clear()
        self._said[topic] = (now, 0)
        self._lines += 1
        self._log.log(getattr(logging, level.upper()), "%s%s", text, f" ({silent} more since)" if silent else "")


# Time limits


# Arguments and parameters


def arguments(description: str) -> argparse.Namespace:
    """The program's arguments; what ROS has to say (`name:=value`) is left to ROS."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument(
        "--parameters", metavar="FILE.json", help="private parameters; they replace those on the parameter server"
    )
    return parser.parse_args([word for word in sys.argv[1:] if ":=" not in word])


def read_parameters(
    path: Optional[str], table: Mapping[str, parameters.Parameter]
) -> Optional[Tuple[Dict[str, Any], List[str]]]:
    """The parameters of a file, or None without one. Raises Fatal."""
    if path is None:
        return None
    try:
        with open(path, encoding="utf-8") as file:
            given = json.load(file)
    except (OSError, ValueError) as problem:
        raise Fatal(f"{path} cannot be read as JSON: {problem}") from None
    if not isinstance(given, dict):
        raise Fatal(f"{path} holds no mapping of parameters")
    return _overlay(table, given, path)


def _overlay(
    table: Mapping[str, parameters.Parameter], given: Mapping[str, Any], where: str
) -> Tuple[Dict[str, Any], List[str]]:
    try:
        return parameters.overlay(table, given)
    except parameters.ParameterError as problem:
        raise Fatal(f"{where}: {problem}") from None


def settle_parameters(
    roscore: Roscore,
    node: str,
    read: Optional[Tuple[Dict[str, Any], List[str]]],
    table: Mapping[str, parameters.Parameter],
) -> Tuple[Dict[str, Any], List[str]]:
    """The parameters in force. Those of a file replace the node's whole namespace; else they are read from there."""
    if read is not None:
        roscore.ask(("setParam", node, {name: value for name, value in read[0].items() if value is not None}))
        return read
    given, do_not_sync = roscore.ask(("getParam", node), ("getParam", "/do_not_sync"))
    given = given if isinstance(given, dict) else {}
    if do_not_sync and "do_not_sync" not in given:
        given["do_not_sync"] = do_not_sync
    return _overlay(table, given, "the parameter server")


# The roscore


def wait_for_roscore(uri: str, timeout: Optional[float] = None) -> str:
    """The URI that the roscore calls itself, as soon as it answers. Raises Fatal after `timeout` seconds."""
    started, said = monotonic(), False
    while True:
        try:
            answer = Rpc(uri, 2.0).call("getUri", "/rosfleet")
            if isinstance(answer, list) and len(answer) == 3 and answer[0] == 1 and isinstance(answer[2], str):
                return answer[2]
            raise ValueError("no URI")
        except FAILURES as problem:
            if timeout is not None and monotonic() - started > timeout:
                raise Fatal(f"the roscore at {uri} does not answer after {timeout:g} s: {problem}") from None
            if not said:
                logger().warning("waiting for the roscore at %s: %s", uri, problem)
                said = True
            notify(f"STATUS=waiting for the roscore at {uri}\nEXTEND_TIMEOUT_USEC=30000000")
            time.sleep(0.2)


def refuse_second(roscore: Roscore, node: str) -> None:
    """A second node of this name would end the first one. Raises Fatal."""
    (uri,) = roscore.ask(("lookupNode", node))
    if not uri:
        return
    try:
        Rpc(uri, 2.0).call("getPid", "/rosfleet")
    except FAILURES:
        return  # it is dead, and its registration is replaced
    raise Fatal(f"a node named {node} is already running at {uri}: stop it, or do not start this one beside it")


class Identity:
    """Whether the roscore is still the one that this node registered with."""

    def __init__(self) -> None:
        self._pid: Any = None
        self.service = ("", "")  # name and URI of a service of this node

    def calls(self) -> List[Tuple[str, ...]]:
        """What to ask the roscore for `check`."""
        return [("getPid",), ("lookupService", self.service[0] or "/-")]

    def check(self, service: Tuple[str, str], pid: Any, service_uri: Any) -> None:
        """The answers, and `service` as it was when they were asked for. Raises Fatal where the roscore is another one."""
        if pid is None:
            raise OSError("the roscore does not tell its process id")
        if self._pid is None:
            self._pid = pid
        if pid != self._pid:
            raise Fatal("the roscore was restarted and knows nothing of this node: starting again")
        if service[0] and service_uri != service[1]:
            raise Fatal(f"the roscore knows {service[0]} no longer as a service of this node: starting again")


# The end


def on_signals(loop: Loop, end: Callable[[], None]) -> None:
    """Have `end` called in the loop on SIGTERM and SIGINT."""
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda _number, _frame: loop.post(end))


def leave_process(status: int) -> None:
    """End the process now, whatever threads of ROS are still waiting for."""
    sys.stderr.flush()
    sys.stdout.flush()
    os._exit(status)


def run(main: Callable[[], int]) -> None:
    """Run a program, and end it with one sentence where it cannot go on."""
    # Python would say something about each questionable pattern that a stranger sends.
    warnings.filterwarnings("ignore", "Possible (nested set|set )", FutureWarning)
    warnings.filterwarnings("ignore", "Flags not at the start", DeprecationWarning)
    try:
        status = main()
    except Fatal as problem:
        logger().error("%s", problem)
        notify(f"STATUS={problem}")
        status = 1
    except KeyboardInterrupt:
        status = 0
    except FAILURES as problem:  # while it started
        logger().error("starting again: %s", problem)
        status = 1
    except Exception as problem:  # ROS's threads would keep a broken program alive
        logger().exception("the program cannot go on: %s", problem)
        status = 1
    leave_process(status)
