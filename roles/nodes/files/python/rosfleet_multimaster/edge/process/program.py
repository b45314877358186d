# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Start and end of a program: its log, arguments, parameters and signals."""

import argparse
import faulthandler
import json
import logging
import os
import signal
import sys
import warnings
import xmlrpc.client
from functools import partial
from typing import Any, Callable, Dict, List, Mapping, Optional, Tuple

from ...protocol import parameters
from ...protocol.filters import InvalidPattern, secret_names
from .. import journal
from ..clock import monotonic
from ..loop import Loop, run_later
from ..roscore import Roscore
from . import memory
from .systemd import notify

FAILURES = (OSError, ValueError, xmlrpc.client.Fault)  # the exceptions of a call to another program

LOG = logging.getLogger("rosfleet")

_EVERY = 60.0  # seconds between two lines about one thing
_LINES = 60  # limited lines in that time, whatever they are about


class Fatal(Exception):
    """The program ends with this sentence."""


def start_log(level: str = "INFO") -> None:
    """Write the log of the program to standard error, from this level on."""
    if not LOG.handlers:
        handler = journal.LineHandler(sys.stderr)
        handler.setFormatter(journal.Format())
        LOG.addHandler(handler)
        LOG.propagate = False
    LOG.setLevel(level)


class LimitedLog:
    """A log with one line of each topic a minute, which says the number of lines that it left out, and few lines of all topics."""

    def __init__(self) -> None:
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
                LOG.warning("%d more lines were not logged", self._dropped)
            self._minute, self._lines, self._dropped = now, 0, 0
        if self._lines >= _LINES:
            self._dropped += 1
            return
        if len(self._said) > 1000:
            self._said.clear()
        self._said[topic] = (now, 0)
        self._lines += 1
        LOG.log(getattr(logging, level.upper()), "%s%s", text, f" ({silent} more since)" if silent else "")


# Arguments and parameters


def read_parameters(description: str, table: parameters.Table) -> Optional[parameters.Overlay]:
    """The parameters of the file that the arguments name, or None without one. Raises Fatal.

    The words of ROS in the arguments (`name:=value`) are left to ROS.
    """
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument(
        "--parameters", metavar="FILE.json", help="private parameters; they replace those on the parameter server"
    )
    path = parser.parse_args([word for word in sys.argv[1:] if ":=" not in word]).parameters
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


def _read_secret_names(value: Any) -> Tuple[List[str], str]:
    """The names in /do_not_sync. Any program may set it, and none may keep a node from starting: then nothing is exchanged."""
    try:
        return list(secret_names(value).items), ""
    except InvalidPattern as problem:
        return ["*"], f"nothing is exchanged until this is corrected, and the node started again: {problem}"


def _overlay(
    table: parameters.Table, given: Mapping[str, Any], where: str, foreign: bool = False
) -> parameters.Overlay:
    try:
        return parameters.overlay(table, given, foreign)
    except parameters.ParameterError as problem:
        raise Fatal(f"{where}: {problem}") from None


def settle_parameters(
    roscore: Roscore, node: str, read: Optional[parameters.Overlay], table: parameters.Table
) -> Dict[str, Any]:
    """The parameters in force. Those of a file replace the node's whole namespace; else they are read from there.

    Starts the log again at their level, and reports their faults there. Raises Fatal.
    """
    if read is None:
        given, do_not_sync = roscore.ask(("getParam", node), ("getParam", "/do_not_sync"))
        given = given if isinstance(given, dict) else {}
        read = _overlay(table, given, "the parameter server", foreign=True)
        problem = ""
        if "do_not_sync" in table and "do_not_sync" not in given:
            read[0]["do_not_sync"], problem = _read_secret_names(do_not_sync)
        if problem:
            read[1].append(problem)
    else:
        roscore.ask(("setParam", node, {name: value for name, value in read[0].items() if value is not None}))
    values, warnings = read
    start_log(values["log_level"])
    for warning in warnings:
        LOG.warning("%s", warning)
    return values


# The end


def on_signals(loop: Loop, end: Callable[[], None]) -> None:
    """Have `end` called in the loop on SIGTERM and SIGINT."""
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda _number, _frame: loop.post(end))


def on_request(job: Callable[[], None]) -> None:
    """Have `job` called on SIGUSR1."""
    signal.signal(signal.SIGUSR1, lambda _number, _frame: job())


def leave_process(status: int) -> None:
    """End the process now, whatever threads of ROS are still waiting for."""
    sys.stderr.flush()
    sys.stdout.flush()
    os._exit(status)


def leave_after(seconds: float) -> None:
    """End the process after a while, whatever still hangs then."""
    run_later(seconds, partial(leave_process, 0))


def give_up(reason: str) -> None:
    """End at once, without a word to others: the service manager starts the program again."""
    LOG.error("%s", reason)
    notify("STOPPING=1", f"STATUS={reason}")
    leave_process(1)


def run(main: Callable[[], int]) -> None:
    """Run a program, and end it with one sentence if it cannot go on."""
    # Python would say something about a questionable regular expression of the own filters; the check of them has said it.
    warnings.filterwarnings("ignore", "Possible (nested set|set )", FutureWarning)
    warnings.filterwarnings("ignore", "Flags not at the start", DeprecationWarning)
    memory.give_back()
    journal.plain_streams()
    start_log()
    faulthandler.enable(2)  # the watchdog's SIGABRT shows the line at which each thread hangs
    status = 1
    try:
        status = main()
    except KeyboardInterrupt:
        status = 0
    except Exception as problem:  # ROS's threads would keep a broken program alive
        start_log()  # whatever ~log_level says
        if isinstance(problem, Fatal):
            LOG.error("%s", problem)
            notify(f"STATUS={problem}")
        elif isinstance(problem, FAILURES):  # while it started
            LOG.error("starting again: %s", problem)
        else:
            LOG.exception("the program cannot go on: %s", problem)
    leave_process(status)
