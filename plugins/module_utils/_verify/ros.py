# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""What a computer sees of the others through ROS, with the commands of section 3.3 of the report, and its own services.

The commands run in the environment of the collection's services, as the user nobody.
"""

import inspect
import json
import os
import pwd
import shutil
import tempfile
import time
import typing
import xmlrpc.client

from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine import processes, systemd
from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine.commands import BASE_PATH, run, text
from ansible_collections.rosfleet.multimaster.plugins.module_utils._verify import listener, texts
from ansible_collections.rosfleet.multimaster.plugins.module_utils._verify.network import PAUSE, TRIES, awaited, server

CALLER = "/multimaster_verify"
SHORTEST = 10  # seconds that a command of ROS may take at least: rospy alone needs several to start on a small computer
LAST = 3  # seconds before the end at which the listener says what it has heard until then
LIST_MASTERS = "/master_discovery/list_masters"
FAREWELL = 10  # seconds that its node has to unregister: on a busy computer Python takes its time
NO_SCRIPT = "rostopic is no script, so the Python of ROS is not known"
_PROPERTIES = ("LoadState", "ActiveState", "SubState", "Result", "NRestarts", "MainPID")


class NoRos(Exception):
    """One sentence: what is missing, and what to do."""


class Ros:
    """The ROS of this computer, as its services see it. To be used in `with`: it has a folder for the nodes' logs."""

    def __init__(self, environment_file: str) -> None:
        self.file = environment_file
        self.variables = texts.environment(text(environment_file))
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

    def missing(self) -> str:
        """Why no node can run here, or empty: a second computer of a robot may be without ROS."""
        try:
            self.command("rostopic")
        except NoRos as problem:
            return str(problem)
        return ""

    def python(self) -> typing.List[str]:
        """The words that run the Python of this computer's ROS; empty where rostopic is no script. Raises NoRos."""
        with open(self.command("rostopic"), "rb") as stream:
            return texts.interpreter(stream.readline())

    def run(self, name: str, arguments: typing.List[str], seconds: float) -> typing.Tuple[str, str]:
        """Output and error of a command; when its time is over it is interrupted, so that its node unregisters."""
        return self.program(name, [self.command(name)] + arguments, max(seconds, SHORTEST))

    def program(self, name: str, words: typing.List[str], limit: float) -> typing.Tuple[str, str]:
        """The same for any program of that many seconds at most; `name` is what its errors call it."""
        argv = ["timeout", "--signal=INT", f"--kill-after={FAREWELL}", f"{limit:.1f}"] + words
        variables = dict(self.variables, PATH=self.variables.get("PATH", BASE_PATH), LC_ALL="C.UTF-8")
        variables.update(HOME=self.folder, ROS_HOME=self.folder, PYTHONUNBUFFERED="1", PYTHONDONTWRITEBYTECODE="1")
        answer = run(argv, variables, limit + 2 * FAREWELL, unprivileged=True)
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
        return {"masters": texts.masters(output), "error": error, "hopeless": False}

    seen = awaited(
        look,
        lambda seen: seen["hopeless"] or wanted <= {entry["name"] for entry in seen["masters"] if entry["online"]},
        deadline,
    )
    return {"masters": seen["masters"], "error": seen["error"], "seconds": round(time.monotonic() - began, 1)}


def topics(
    ros: Ros, talkers: typing.List[str], label: str, own: str, deadline: float
) -> typing.List[typing.Dict[str, typing.Any]]:
    """What every talker's topic says here, all heard by one node, and who is registered as its publisher."""
    if not talkers or ros.missing():
        return []
    awaited(lambda: _answers(ros), bool, deadline)
    heard, error = listen(ros, talkers, label, own, deadline)
    try:
        published = _published(ros)
    except OSError as problem:
        published, error = {}, str(problem)
    found = []
    for talker in talkers:
        entry = _topic(talker)
        said = heard.get(entry["topic"], {})
        nodes = published.get(entry["topic"]) or ([said["node"]] if said.get("node") else [])
        entry["publishers"] = [{"node": node, "uri": _uri(ros, node)} for node in nodes]
        entry["heard"] = said.get("text") == texts.sentence_of(label, talker)
        entry.update((key, said[key]) for key in ("text", "seconds") if key in said)
        if said and not entry["heard"]:
            entry["error"] = "heard '{}' instead".format(entry["text"])
        elif not entry["heard"]:
            unknown = published and entry["topic"] not in published
            entry["error"] = f"the topic is not registered at {ros.uri}" if unknown else error or "nothing"
        found.append(entry)
    return found


def _published(ros: Ros) -> typing.Dict[str, typing.List[str]]:
    """{topic: publishers} at the roscore. Raises OSError.

    A roscore where much is registered at the same time may answer 500, since it looks through what is being changed.
    """
    for unused in range(TRIES - 1):
        try:
            return dict(ros.ask("getSystemState")[0])
        except OSError:
            time.sleep(PAUSE)
    return dict(ros.ask("getSystemState")[0])


def _answers(ros: Ros) -> bool:
    try:
        return bool(ros.ask("getUri"))
    except OSError:
        return False


def listen(
    ros: Ros, talkers: typing.List[str], label: str, own: str, deadline: float
) -> typing.Tuple[typing.Dict[str, typing.Dict[str, typing.Any]], str]:
    """{topic: text and seconds} of what a node of this computer hears, and an error or ''.

    One node for all topics: rospy takes half a second of a processor to start, and there is one for each computer.
    """
    words = ros.python()
    if not words:
        return {}, NO_SCRIPT
    path = os.path.join(ros.folder, "listener.py")
    with open(path, "w") as stream:
        stream.write(inspect.getsource(listener))
    os.chmod(path, 0o644)
    wanted = {texts.topic_of(talker): texts.sentence_of(label, talker) for talker in talkers}
    limit = max(deadline - time.monotonic(), SHORTEST)
    words += [path, texts.listener_of(own), f"{time.time() + limit - LAST:.1f}", json.dumps(wanted)]
    output, error = ros.program("the listener", words, limit)
    try:
        return json.loads(output), error
    except ValueError:
        return {}, f"the listener failed: {error or 'it printed nothing'}"


def _topic(talker: str) -> typing.Dict[str, typing.Any]:
    return {
        "computer": talker,
        "topic": texts.topic_of(talker),
        "publishers": [],
        "heard": False,
        "text": "",
        "seconds": None,
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
                entry["differing"] = texts.differing(processes.environment(pid), variables)
            except OSError:
                entry["differing"] = None  # it ended since, or is not ours to look at
        found.append(entry)
    return found


def _show(unit: str) -> typing.Dict[str, str]:
    shown = systemd.show([unit], _PROPERTIES).units
    return shown[0] if shown else {}


def start_talker(ros: Ros, label: str, computer: str, lifetime: int) -> str:
    """Start `rostopic pub` as a unit that ends by itself; an older one of ours ends first. Returns an error or ''."""
    stop_talker()
    folder = texts.TALKER[: -len(".service")]
    options = {
        "DynamicUser": "yes",
        "RuntimeDirectory": folder,
        "EnvironmentFile": ros.file,
        "RuntimeMaxSec": str(lifetime),
        "KillSignal": "SIGINT",  # so that its node unregisters
        "TimeoutStopSec": str(FAREWELL),
    }
    argv = ["systemd-run", "--quiet", "--collect", "--unit=" + texts.TALKER]
    argv += ["--description=Talker of the verification of rosfleet.multimaster"]
    argv += ["--property={}={}".format(*option) for option in sorted(options.items())]
    argv += [f"--setenv={name}=/run/{folder}" for name in ("HOME", "ROS_HOME", "ROS_LOG_DIR")]
    argv += ["--setenv=PYTHONDONTWRITEBYTECODE=1", "--"]
    message = f"data: '{texts.sentence_of(label, computer)}'"
    argv += [ros.command("rostopic"), "pub", "-r", "5", texts.topic_of(computer), "std_msgs/String", message]
    argv.append("__name:=" + texts.node_of(label, computer))
    answer = run(argv, limit=30)
    return "" if answer.status == 0 else answer.error or f"systemd-run ended with status {answer.status}"


def stop_talker() -> None:
    """End the talker, if there is one."""
    run(["systemctl", "stop", texts.TALKER], limit=30)


def talker() -> typing.Dict[str, typing.Any]:
    """Whether the talker runs, and the last line that it wrote where it does not."""
    state = _show(texts.TALKER).get("ActiveState", "")
    if state == "active":
        return {"running": True, "error": ""}
    lines = run(["journalctl", "--quiet", "--no-pager", "--output=cat", "--lines=5", "--unit=" + texts.TALKER])
    said = lines.output.decode("utf-8", "replace").strip().splitlines()
    return {"running": False, "error": said[-1] if said else "it did not run"}
