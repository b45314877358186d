# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The ROS of this computer: its commands, its roscore, and the masters that its discovery node lists.

The commands are those of section 3.3 of the report. They run in the environment of the collection's services, which may be
that of a person's workspace, so they are foreign code: without rights, and with a folder of their own that root never opens.
"""

import shlex
import shutil
import socket
import time
import typing

from ..._base.commands import BASE_PATH, text
from ..._base.deadlines import poll, stretch
from ..._base.foreign import foreign
from ..._base.plain_text import plain
from ..._base.problem import explain_error
from ..._base.regular_files import read_regular
from ..._contract.outcomes import Outcome
from ..._machine import ports
from ..._machine.outcomes import classify_error, connect
from . import node_services, tcpros
from .hosts import place_of
from .silence import Silence
from .xml_rpc import Tables, ask, read_state

CALLER = "/multimaster_verify"
LIST_MASTERS = "/master_discovery/list_masters"  # of the nodes that the collection starts; others may have other names
OPENS = 2.0  # seconds in which a TCP connection to a roscore that does not answer is to open
KILLED = 10  # seconds after which a program is killed that does not end at its limit


class Ros:
    """The ROS of this computer, as its services see it."""

    def __init__(self, environment_file: str, without: typing.Optional[typing.Mapping[str, str]] = None) -> None:
        """`without`: the variables if the file is not there."""
        self.file = environment_file
        self.variables = environment(text(environment_file)) or dict(without or {})
        self.uri = self.variables.get("ROS_MASTER_URI", "")
        self._silence = Silence()

    def problem(self, command: str = "rostopic") -> str:
        """Say why no node can run here, by a command of ROS, or nothing: a second computer of a robot may be without ROS."""
        if not self.uri:
            return f"{self.file} has no ROS_MASTER_URI; run site.yml before the verification"
        if self._find(command) is None:
            return f"there is no command {command} in the PATH of {self.file}; install it"
        return ""

    def _find(self, command: str) -> typing.Optional[str]:
        return shutil.which(command, path=self.variables.get("PATH", BASE_PATH))

    def run_python(self, program: str, limit: float, given: str) -> typing.Tuple[str, str]:
        """Run the text of a program under the Python of this computer's ROS, which gets `given`; return its output, and an error or ''.

        Raises OSError, and socket.timeout where it takes too long.
        """
        script = self._find("rostopic")
        if script is None:
            raise OSError(self.problem())
        words = interpreter(read_regular(script, 4096))
        if not words:
            return "", "rostopic is no script, so the Python of ROS is not known"
        limit = stretch(limit)
        argv = ["timeout", f"--kill-after={KILLED}", f"{limit:.1f}", *words, "-c", program]
        variables = dict(self.variables, PATH=self.variables.get("PATH", BASE_PATH), LC_ALL="C.UTF-8")
        variables.update(PYTHONUNBUFFERED="1", PYTHONDONTWRITEBYTECODE="1")
        answer = foreign(argv, variables, limit + 2 * KILLED, given, homes=("HOME", "ROS_HOME", "ROS_LOG_DIR"))
        if answer.status == 124:  # timeout(1)
            raise socket.timeout(f"the Python of ROS printed nothing within {limit:.0f} s")
        error = answer.last_error or f"the Python of ROS ended with status {answer.status}"
        return answer.text, plain(error) if answer.status else ""

    def ask(self, method: str, *arguments: typing.Any, caller: str = CALLER, patient: bool = False) -> typing.Any:
        """Call a method of the master API. Raises OSError with a sentence if the roscore gives no value.

        A roscore that has been silent for long is asked again by the `patient` alone.
        """
        return self._silence.ask(lambda: ask(self.uri, caller, method, *arguments), patient)

    def read_state(self, patient: bool = False) -> Tables:
        """Read publishers, subscribers and services: {name: nodes}. Raises OSError."""
        return self._silence.ask(lambda: read_state(self.uri, CALLER), patient)


def roscore(ros: Ros, deadline: float) -> typing.Dict[str, typing.Any]:
    """Ask the roscore of ROS_MASTER_URI for the URI by which its nodes know it."""
    seen = wait_for_roscore(ros, deadline)
    return _look_closer(seen) if seen["outcome"] == Outcome.NO_ANSWER.value else seen


def wait_for_roscore(ros: Ros, deadline: float) -> typing.Dict[str, typing.Any]:
    """Ask the roscore for its URI until it answers, or until the deadline (monotonic seconds)."""

    def look() -> typing.Dict[str, typing.Any]:
        try:
            answer = str(ros.ask("getUri", patient=True))
            return {"uri": ros.uri, "answer": answer, "error": "", "outcome": Outcome.ANSWERED.value}
        except OSError as problem:
            outcome = classify_error(problem.__cause__)[0]
            return {"uri": ros.uri, "answer": "", "error": str(problem), "outcome": outcome.value}

    if not ros.uri:
        error = f"{ros.file} has no ROS_MASTER_URI"
        return {"uri": "", "answer": "", "error": error, "outcome": Outcome.NOT_TRIED.value}
    return dict(poll(look, lambda seen: not seen["error"], deadline))


def _look_closer(seen: typing.Dict[str, typing.Any]) -> typing.Dict[str, typing.Any]:
    """Add the outcome of a mere connection, and how many wait to be taken: this distinguishes a roscore that hangs from a packet filter."""
    host, port = place_of(seen["uri"])
    if not host or not port:
        return seen
    return dict(seen, tcp_outcome=connect(host, port, OPENS).outcome.value, waiting=ports.count_waiting(port))


def list_masters(ros: Ros, wanted: typing.Set[str], deadline: float) -> typing.Dict[str, typing.Any]:
    """Call the service of `rosservice call /master_discovery/list_masters`, again until the wanted names are online.

    A discovery node that a person has started may have another name, as that of fkie_mas has.
    """
    began = time.monotonic()
    missing = ros.problem("rosservice")
    if missing:
        return {"masters": [], "error": missing, "seconds": 0.0}

    def look() -> typing.Dict[str, typing.Any]:
        try:
            own = node_services.find_own(ros.uri, CALLER, ros.read_state(patient=True)[2], node_services.LIST_MASTERS)
            service = own[0] if own else LIST_MASTERS
            rows, _type = tcpros.call_by_name(ros.uri, service, tcpros.LIST_MASTERS, CALLER)
        except OSError as problem:
            return {"masters": [], "error": plain(explain_error(problem))}
        return {
            "masters": [{key: row[key] for key in ("name", "uri", "online", "monitoruri")} for row in rows],
            "error": "",
        }

    seen = poll(look, lambda seen: wanted <= {row["name"] for row in seen["masters"] if row["online"]}, deadline)
    return dict(seen, seconds=round(time.monotonic() - began, 1))


def interpreter(script: bytes) -> typing.List[str]:
    """Return the words of a script's first line (execve(2)), which run it; empty if it is no script."""
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
