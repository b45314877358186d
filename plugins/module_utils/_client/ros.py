# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The ROS of this computer: its commands, its roscore, and the masters that its discovery node lists.

The commands are those of section 3.3 of the report. They run in the environment of the collection's services, which may be
that of a person's workspace, so they are foreign code: without rights, and with a folder of their own that root never opens.
"""

import shlex
import shutil
import time
import typing

from .._machine.outcomes import Outcome, classify_error
from .._module.plain_text import plain
from .._module.regular_files import read_regular
from .._process.commands import BASE_PATH, text
from .._process.deadlines import poll
from .._process.foreign import foreign
from . import tcpros
from .xml_rpc import ask

CALLER = "/multimaster_verify"
LIST_MASTERS = "/master_discovery/list_masters"
FAREWELL = 10  # seconds that its node has to unregister: on a busy computer Python takes its time
NO_SCRIPT = "rostopic is no script, so the Python of ROS is not known"


class RosMissing(Exception):
    """ROS is missing here; one sentence says what, and what to do."""


class Ros:
    """The ROS of this computer, as its services see it."""

    def __init__(self, environment_file: str, without: typing.Optional[typing.Mapping[str, str]] = None) -> None:
        """`without`: the variables where the file is not there."""
        self.file = environment_file
        self.variables = environment(text(environment_file)) or dict(without or {})
        self.uri = self.variables.get("ROS_MASTER_URI", "")

    def command(self, name: str) -> str:
        """The path of a command of ROS. Raises RosMissing."""
        if not self.uri:
            raise RosMissing(f"{self.file} has no ROS_MASTER_URI; run site.yml before the verification")
        path = shutil.which(name, path=self.variables.get("PATH", BASE_PATH))
        if path is None:
            raise RosMissing(f"there is no command {name} in the PATH of {self.file}; install it")
        return path

    def problem(self) -> str:
        """Say why no node can run here, or nothing: a second computer of a robot may be without ROS."""
        try:
            self.command("rostopic")
        except RosMissing as problem:
            return str(problem)
        return ""

    def python(self) -> typing.List[str]:
        """Return the words that run the Python of this computer's ROS; empty where rostopic is no script. Raises RosMissing."""
        return interpreter(read_regular(self.command("rostopic"), 4096))

    def program(self, name: str, words: typing.List[str], limit: float, given: str = "") -> typing.Tuple[str, str]:
        """Run a program for `limit` seconds at most; return its output and its error, which calls it `name`. `given` is its input.

        At its time limit it is interrupted, so its node unregisters.
        """
        argv = ["timeout", "--signal=INT", f"--kill-after={FAREWELL}", f"{limit:.1f}"] + words
        variables = dict(self.variables, PATH=self.variables.get("PATH", BASE_PATH), LC_ALL="C.UTF-8")
        variables.update(PYTHONUNBUFFERED="1", PYTHONDONTWRITEBYTECODE="1")
        answer = foreign(argv, variables, limit + 2 * FAREWELL, given, homes=("HOME", "ROS_HOME", "ROS_LOG_DIR"))
        output = answer.text
        if answer.status == 0:
            return output, ""
        if answer.status == 124:  # timeout(1)
            return output, f"{name} printed nothing within {limit:.0f} s"
        return output, plain(answer.last_error or f"{name} ended with status {answer.status}")

    def ask(self, method: str, *arguments: typing.Any, caller: str = CALLER) -> typing.Any:
        """Call a method of the master API. Raises OSError with a sentence where the roscore gives no value."""
        return ask(self.uri, caller, method, *arguments)


def roscore(ros: Ros, deadline: float) -> typing.Dict[str, str]:
    """Ask the roscore of ROS_MASTER_URI for the URI by which its nodes know it."""

    def look() -> typing.Dict[str, str]:
        try:
            return {"uri": ros.uri, "answer": ros.ask("getUri"), "error": "", "outcome": Outcome.ANSWERED.value}
        except OSError as problem:
            outcome = classify_error(problem.__cause__)[0]
            return {"uri": ros.uri, "answer": "", "error": str(problem), "outcome": outcome.value}

    if not ros.uri:
        error = f"{ros.file} has no ROS_MASTER_URI"
        return {"uri": "", "answer": "", "error": error, "outcome": Outcome.NOT_TRIED.value}
    return poll(look, lambda seen: not seen["error"], deadline)


def list_masters(ros: Ros, wanted: typing.Set[str], deadline: float) -> typing.Dict[str, typing.Any]:
    """Do what `rosservice call /master_discovery/list_masters` does, again until the wanted names are online."""
    began = time.monotonic()

    def look() -> typing.Dict[str, typing.Any]:
        try:
            ros.command("rosservice")
            uri = str(ros.ask("lookupService", LIST_MASTERS))
            rows = tcpros.call(uri, LIST_MASTERS, tcpros.LIST_MASTERS, CALLER)
        except RosMissing as problem:
            return {"masters": [], "error": str(problem), "hopeless": True}
        except OSError as problem:
            return {"masters": [], "error": plain(problem), "hopeless": False}
        masters = [{key: row[key] for key in ("name", "uri", "online", "monitoruri")} for row in rows]
        return {"masters": masters, "error": "", "hopeless": False}

    seen = poll(
        look,
        lambda seen: seen["hopeless"] or wanted <= {entry["name"] for entry in seen["masters"] if entry["online"]},
        deadline,
    )
    return {"masters": seen["masters"], "error": seen["error"], "seconds": round(time.monotonic() - began, 1)}


def interpreter(script: bytes) -> typing.List[str]:
    """Return the words of a script's first line (execve(2)), which run it; empty where it is no script."""
    line = script.split(b"\n", 1)[0].decode("utf-8", "replace")
    return line[2:].split() if line.startswith("#!") else []


def environment(content: str) -> typing.Dict[str, str]:
    """Read an environment file (systemd.exec(5)): values plain, or in double quotes, as this collection writes them."""
    variables = {}
    for line in content.split("\n"):
        name, equals, value = line.partition("=")
        if equals and not line.startswith(("#", ";")):
            try:
                variables[name.strip()] = "".join(shlex.split(value))
            except ValueError:  # an unfinished quotation
                variables[name.strip()] = value
    return variables
