# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause
# Private to this collection: may change at any time.

"""What a computer sees of the others through ROS, with the commands of section 3.3 of the report, and its own services.

The commands run in the environment of the collection's services, as the user nobody.
"""

import os
import pwd
import shutil
import tempfile
import time
import typing
import xmlrpc.client

from ansible_collections.rosfleet.multimaster.plugins.module_utils import _probe
from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine import BASE_PATH, run, text
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe_network import awaited, concurrently, server

CALLER = "/multimaster_verify"
SHORTEST = 10  # seconds that a command of ROS may take at least: rospy alone needs several to start on a small computer
COMMANDS = 6  # how many of them run at once
LIST_MASTERS = "/master_discovery/list_masters"
_PROPERTIES = ("LoadState", "ActiveState", "SubState", "Result", "NRestarts", "MainPID")


class NoRos(Exception):
    """One sentence: what is missing, and what to do."""


class Ros:
    """The ROS of this computer, as its services see it. To be used in `with`: it has a folder for the nodes' logs."""

    def __init__(self, environment_file: str) -> None:
        self.file = environment_file
        self.variables = _probe.environment(text(environment_file))
        self.uri = self.variables.get("ROS_MASTER_URI", "")
        self.folder = ""

    def __enter__(self) -> "Ros":
        self.folder = tempfile.mkdtemp(prefix="multimaster-verify-")
        try:
            nobody = pwd.getpwnam("nobody")
            os.chown(self.folder, nobody.pw_uid, nobody.pw_gid)
        except (KeyError, PermissionError):
            pass  # not root: the commands run as this user
        return self

    def __exit__(self, *error: typing.Any) -> None:
        shutil.rmtree(self.folder, ignore_errors=True)

    def command(self, name: str) -> str:
        """The path of a command of ROS. Raises NoRos."""
        if not self.uri:
            raise NoRos(f"{self.file} has no ROS_MASTER_URI; run site.yml before the verification")
        path = shutil.which(name, path=self.variables.get("PATH", BASE_PATH))
        if path is None:
            raise NoRos(f"there is no command {name} in the PATH of {self.file}; install it")
        return path

    def run(self, name: str, arguments: typing.List[str], seconds: float) -> typing.Tuple[str, str]:
        """Output and error of a command; when its time is over it is interrupted, so that its node unregisters."""
        limit = max(seconds, SHORTEST)
        argv = ["timeout", "--signal=INT", "--kill-after=3", f"{limit:.1f}", self.command(name)] + arguments
        variables = dict(self.variables, PATH=self.variables.get("PATH", BASE_PATH), LC_ALL="C.UTF-8")
        variables.update(HOME=self.folder, ROS_HOME=self.folder, PYTHONUNBUFFERED="1", PYTHONDONTWRITEBYTECODE="1")
        answer = run(argv, variables, limit + 5, unprivileged=True)
        output = answer.output.decode("utf-8", "replace")
        if answer.status == 0:
            return output, ""
        if answer.status == 124:  # timeout(1)
            return output, f"{name} printed nothing within {limit:.0f} s"
        return output, (answer.error.splitlines() or [f"{name} ended with status {answer.status}"])[-1]

    def ask(self, method: str, *arguments: typing.Any) -> typing.Any:
        """A call of the master API. Raises OSError with a sentence where the roscore gives no value."""
        try:
            code, message, value = getattr(server(self.uri), method)(CALLER, *arguments)
        except OSError as problem:
            raise OSError(f"{self.uri}: {problem.strerror or problem}") from problem
        except xmlrpc.client.Error as problem:
            raise OSError(f"{self.uri}: {problem}") from problem
        except Exception as problem:  # http.client's and expat's own: something else than a roscore
            raise OSError(f"{self.uri} answers, but not as a roscore ({type(problem).__name__})") from problem
        if code != 1:
            raise OSError(f"{self.uri}: {method}: {message}")
        return value


def roscore(ros: Ros, deadline: float) -> typing.Dict[str, str]:
    """The master that ROS_MASTER_URI means: by which URI it is known to its nodes."""

    def look() -> typing.Dict[str, str]:
        try:
            return {"uri": ros.uri, "answer": ros.ask("getUri"), "error": ""}
        except OSError as problem:
            return {"uri": ros.uri, "answer": "", "error": str(problem)}

    if not ros.uri:
        return {"uri": "", "answer": "", "error": f"{ros.file} has no ROS_MASTER_URI"}
    return awaited(look, lambda seen: not seen["error"], deadline)


def list_masters(ros: Ros, wanted: typing.Set[str], deadline: float) -> typing.Dict[str, typing.Any]:
    """`rosservice call /master_discovery/list_masters`, again until the wanted names are online."""
    began = time.monotonic()

    def look() -> typing.Dict[str, typing.Any]:
        try:
            output, error = ros.run("rosservice", ["call", LIST_MASTERS], deadline - time.monotonic())
        except NoRos as problem:
            return {"masters": [], "error": str(problem), "hopeless": True}
        return {"masters": _probe.masters(output), "error": error, "hopeless": False}

    seen = awaited(
        look,
        lambda seen: seen["hopeless"] or wanted <= {entry["name"] for entry in seen["masters"] if entry["online"]},
        deadline,
    )
    return {"masters": seen["masters"], "error": seen["error"], "seconds": round(time.monotonic() - began, 1)}


def topics(
    ros: Ros, talkers: typing.List[str], label: str, deadline: float
) -> typing.List[typing.Dict[str, typing.Any]]:
    """`rostopic echo` of every talker's topic once it is registered here, and who is registered as its publisher."""
    began = time.monotonic()
    problems: typing.List[str] = []

    def look() -> typing.Dict[str, typing.List[str]]:
        try:
            state = ros.ask("getSystemState")
        except OSError as problem:
            problems.append(str(problem))
            return {}
        return dict(state[0])

    def missing(published: typing.Dict[str, typing.List[str]]) -> bool:
        return any(_probe.topic_of(talker) not in published for talker in talkers)

    if not talkers or not ros.uri:
        return []
    published = awaited(look, lambda seen: not missing(seen), deadline)
    registered = time.monotonic() - began

    def hear(talker: str) -> typing.Dict[str, typing.Any]:
        topic = _probe.topic_of(talker)
        nodes = published.get(topic, [])
        entry = _topic(talker, nodes=[{"node": node, "uri": _uri(ros, node)} for node in nodes])
        entry["registered_s"] = round(registered, 1) if nodes else None
        if not nodes:
            entry["error"] = problems[-1] if problems and not published else f"the topic is not registered at {ros.uri}"
            return entry
        try:
            output, entry["error"] = ros.run("rostopic", ["echo", "-n", "1", topic], deadline - time.monotonic())
        except NoRos as problem:
            entry["error"] = str(problem)
            return entry
        entry["text"] = _probe.data(output)
        entry["heard"] = entry["text"] == _probe.sentence_of(label, talker)
        if entry["heard"]:
            entry["error"] = ""
        elif entry["text"]:
            entry["error"] = "heard '{}' instead".format(entry["text"])
        return entry

    return concurrently(
        hear, talkers, 600.0, lambda talker: dict(_topic(talker), error="no time was left for it"), COMMANDS
    )


def _topic(talker: str, nodes: typing.Sequence[typing.Dict[str, str]] = ()) -> typing.Dict[str, typing.Any]:
    return {
        "computer": talker,
        "topic": _probe.topic_of(talker),
        "publishers": list(nodes),
        "registered_s": None,
        "heard": False,
        "text": "",
        "error": "",
    }


def _uri(ros: Ros, node: str) -> str:
    try:
        return ros.ask("lookupNode", node)
    except OSError:
        return ""  # it ended since


def services(names: typing.List[str], variables: typing.Dict[str, str]) -> typing.List[typing.Dict[str, typing.Any]]:
    """The collection's services: their state, and whether their process really has the environment of the file."""
    found = []
    for name in names:
        unit = f"multimaster-{name}.service"
        seen = _show(unit)
        entry: typing.Dict[str, typing.Any] = {
            "name": name,
            "unit": unit,
            "load_state": seen.get("LoadState", ""),
            "active_state": seen.get("ActiveState", ""),
            "sub_state": seen.get("SubState", ""),
            "restarts": int(seen.get("NRestarts") or 0),
            "differing": [],
        }
        pid = seen.get("MainPID", "0")
        if pid != "0":
            try:
                with open(f"/proc/{pid}/environ", "rb") as stream:
                    entry["differing"] = _probe.differing(stream.read(), variables)
            except OSError:
                entry["differing"] = None  # it ended since, or is not ours to look at
        found.append(entry)
    return found


def _show(unit: str) -> typing.Dict[str, str]:
    answer = run(["systemctl", "show", unit, "--property=" + ",".join(_PROPERTIES)])
    return _probe.properties(answer.output.decode("utf-8", "replace"))


def start_talker(ros: Ros, label: str, computer: str, lifetime: int) -> str:
    """Start `rostopic pub` as a unit that ends by itself; an older one of ours ends first. Returns an error or ''."""
    stop_talker()
    folder = _probe.TALKER[: -len(".service")]
    options = {
        "DynamicUser": "yes",
        "RuntimeDirectory": folder,
        "EnvironmentFile": ros.file,
        "RuntimeMaxSec": str(lifetime),
        "KillSignal": "SIGINT",  # so that its node unregisters
        "TimeoutStopSec": "5",
    }
    argv = ["systemd-run", "--quiet", "--collect", "--unit=" + _probe.TALKER]
    argv += ["--description=Talker of the verification of rosfleet.multimaster"]
    argv += ["--property={}={}".format(*option) for option in sorted(options.items())]
    argv += [f"--setenv={name}=/run/{folder}" for name in ("HOME", "ROS_HOME", "ROS_LOG_DIR")]
    argv += ["--setenv=PYTHONDONTWRITEBYTECODE=1", "--"]
    message = f"data: '{_probe.sentence_of(label, computer)}'"
    argv += [ros.command("rostopic"), "pub", "-r", "5", _probe.topic_of(computer), "std_msgs/String", message]
    answer = run(argv, limit=30)
    return "" if answer.status == 0 else answer.error or f"systemd-run ended with status {answer.status}"


def stop_talker() -> None:
    """End the talker, if there is one."""
    run(["systemctl", "stop", _probe.TALKER], limit=30)


def talker() -> typing.Dict[str, typing.Any]:
    """Whether the talker runs, and the last line that it wrote where it does not."""
    state = _show(_probe.TALKER).get("ActiveState", "")
    if state == "active":
        return {"running": True, "error": ""}
    lines = run(["journalctl", "--quiet", "--no-pager", "--output=cat", "--lines=5", "--unit=" + _probe.TALKER])
    said = lines.output.decode("utf-8", "replace").strip().splitlines()
    return {"running": False, "error": said[-1] if said else "it did not run"}
