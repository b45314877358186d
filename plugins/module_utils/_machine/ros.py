# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The installations of ROS 1 on this machine, and the environment that each gives to a program.

A user without any rights sources a set-up file and imports rospy. The services run as such a user, and a person's
workspace is no code for root. Its answer is not trusted: each value is checked.
"""

import glob
import os
import re
import shlex
import shutil
import typing

from .._base import processes, trust
from .._base.commands import BASE_PATH, CLEAN, find_nobody, run
from .._base.foreign import foreign, last_line
from .._base.plain_text import is_plain, plain, quote
from .._base.problem import Problem
from . import fkie, set_up

PYTHON = "/usr/bin/python3"  # the target of Debian's packages and of most ROS on Python 3
PYTHON2 = "/usr/bin/python2.7"  # the target of the ROS distributions before Noetic
MODULES = ("rospy", "genpy", "rosgraph", "std_msgs", "std_srvs")
COMMANDS = ("roscore", "rostopic", "rosservice")
CONDA = "CONDA_PREFIX"  # set by conda: the folder of an environment, which may have a ROS of RoboStack
_OF_CONDA = "conda-meta"  # a folder of conda in each environment
HOOKS = "etc/catkin/profile.d"  # in a prefix: the files that its set-up file sources at its end
_DEBIAN = "/usr/lib/python3/dist-packages/rospy"
_IN_A_FOLDER = ("setup.bash", "setup.sh", "devel/setup.bash", "install/setup.bash")
_SHELLS = {".bash": "bash", ".sh": "sh", ".zsh": "zsh"}
_SOURCING = 10.0  # seconds; catkin's own file takes 0.2 on a PC
_IMPORTING = 60.0  # seconds; 0.4 on a PC, cold on a small robot ten

_LARGEST = 64 << 10  # bytes of all variables; more than 128 KiB in one of them, and no program starts any more
_LISTS = ("PATH", "PYTHONPATH", "LD_LIBRARY_PATH")
_OF_THE_SHELL = ("PWD", "OLDPWD", "SHLVL", "_", "HOME", "LC_ALL")
_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")

_VERSION = re.compile(r"[23]\.[0-9]{1,3}\.[0-9]{1,3}")
_IMPORT = """
import importlib, json, sys
missing = []
for name in sys.argv[1:]:
    try:
        importlib.import_module(name)
    except Exception:
        missing.append(name)
print()
print(json.dumps({"version": "%d.%d.%d" % sys.version_info[:3], "missing": missing}))
"""

_CLOSED = """
import os, sys
for path in sys.argv[1:]:
    parts = path.split("/")
    for end in range(2, len(parts) + 1):
        part = "/".join(parts[:end])
        folder = end < len(parts) or os.path.isdir(part)
        if not os.access(part, os.X_OK if folder else os.R_OK):
            print(part)
            sys.exit()
"""


Record = typing.Dict[str, typing.Any]


def find(
    choice: str = "auto",
    nodes: typing.Sequence[Record] = (),
    root: str = "/opt/ros",
    debian: str = _DEBIAN,
) -> Record:
    """Return `found`, `chosen` and `problem`: the installations of ROS, the one to use, and a sentence if that fails.

    `choice` is "auto", "debian", or the path of a set-up file or of its folder; `nodes` are executables to find in the
    chosen installation.
    """
    try:
        found = [examine(kind, setup, root) for kind, setup in candidates(choice, root, debian)]
    except Problem as problem:
        return {"found": [], "chosen": None, "problem": str(problem)}
    chosen, wrong = choose(found, root)
    if chosen:
        chosen["nodes"] = fkie.nodes(list(nodes), chosen["python"], full(chosen["environment"]))
    return {"found": found, "chosen": chosen, "problem": wrong}


def candidates(choice: str, root: str = "/opt/ros", debian: str = _DEBIAN) -> typing.List[typing.Tuple[str, str]]:
    """List (kind, set-up file) of the meanings of `choice`, in the order of preference. Raises Problem."""
    if choice == "auto":
        prefixes = [("prefix", setup_file(os.path.dirname(path))) for path in sorted(glob.glob(root + "/*/setup.sh"))]
        return prefixes + ([("debian", "")] if os.path.isdir(debian) else [])
    if choice == "debian":
        if not os.path.isdir(debian):
            raise Problem(
                f"multimaster_ros_setup is debian, but {debian} is not there; install python3-rospy, or name a set-up file."
            )
        return [("debian", "")]
    setup = setup_file(choice)
    return [("prefix" if os.path.dirname(os.path.dirname(setup)) == root else "workspace", setup)]


def setup_file(path: str) -> str:
    """Find the set-up file that a path names, itself or as its folder. Raises Problem."""
    path = os.path.normpath(path)
    if os.path.isfile(path):
        return path
    for name in _IN_A_FOLDER:
        if os.path.isfile(os.path.join(path, name)):
            return os.path.join(path, name)
    raise Problem(
        f"multimaster_ros_setup is {path}, but that is neither a file nor a folder with {' or '.join(_IN_A_FOLDER)}; "
        "name the set-up file that a person sources."
    )


def choose(found: typing.List[Record], root: str = "/opt/ros") -> typing.Tuple[typing.Any, str]:
    """Return the installation to use, or None, and a sentence about its problem."""
    ros1 = [record for record in found if record["version"] != "2"]
    prefixes = [record for record in ros1 if record["kind"] == "prefix"]
    if not ros1:
        others = ", ".join(quote(record["setup"]) for record in found)
        neither = f"neither {root}/<distro>/setup.sh nor Debian's python3-rospy"
        seen = f"only ROS 2 ({others})" if others else neither
        return (
            None,
            f"There is no ROS 1: {seen}; install it, or name a workspace's set-up file in multimaster_ros_setup.",
        )
    if len(prefixes) > 1:
        setups = ", ".join(quote(record["setup"]) for record in prefixes)
        return None, f"ROS 1 is here more than once ({setups}); name the one to use in multimaster_ros_setup."
    return ros1[0], ros1[0]["problem"]


def examine(kind: str, setup: str, root: str = "/opt/ros") -> Record:
    """Read one installation: its environment, its commands, and a trial import of rospy."""
    environment, problem = source(setup) if setup else ({}, "")
    variables = set_up.sort(environment)
    reach = set_up.reach(setup, variables)
    environment = {} if reach.refusal else variables.usable
    if reach.refusal:
        problem = (
            f"The set-up file {quote(setup)} is no code for the services, since {reach.refusal}; expected files and folders that "
            "only one user can change: take the right to write away from others (chmod o-w)."
        )
    below, for_root = ("", reach.for_root) if not reach.doubt else find_underlay(setup, environment, root)
    folder, closed_hooks = hooks(environment)
    fallback = {"prefix": os.path.basename(os.path.dirname(setup)), "workspace": "", "debian": "debian"}
    version = "2" if environment.get("ROS_VERSION") == "2" else "1"
    record = {
        "kind": kind,
        "setup": setup,
        "distro": environment.get("ROS_DISTRO") or fallback[kind],
        "version": version,
        "python": PYTHON,
        "python_version": "",
        "environment": environment,
        "for_root": for_root,
        "below": below,
        "person": reach.person,
        "doubt": reach.doubt,
        "left_out": [plain(name) for name in variables.left_out],
        "rospy": False,
        "missing": list(MODULES),
        "commands": {name: shutil.which(name, path=full(environment)["PATH"]) or "" for name in COMMANDS},
        "hooks": folder,
        "hooks_doubt": closed_hooks,
        "nodes": [],
        "problem": problem,
    }
    if not problem and version == "1":
        record.update(_import(setup, environment))
    return record


def find_underlay(
    setup: str, environment: typing.Dict[str, str], root: str
) -> typing.Tuple[str, typing.Dict[str, str]]:
    """Return the set-up file in `root` below a person's workspace, and its variables for root; both empty without one.

    The workspace gives only the name of the installation, which is then sourced and judged on its own.
    """
    installed = {os.path.dirname(path) for path in glob.glob(root + "/*/setup.sh")} - {os.path.dirname(setup)}
    for prefix in environment.get("CMAKE_PREFIX_PATH", "").split(":"):
        if prefix in installed:
            below = setup_file(prefix)
            variables = set_up.sort(source(below)[0])
            for_root = set_up.reach(below, variables).for_root
            if for_root and for_root.get("ROS_VERSION") != "2":
                return below, for_root
    return "", {}


def source(setup: str) -> typing.Tuple[typing.Dict[str, str], str]:
    """Source a set-up file as nobody; return the variables that it adds to a clean environment, or a sentence."""
    shell = _SHELLS.get(os.path.splitext(setup)[1], "bash")
    # No positional parameters: catkin's files hand theirs on. Their output is not the environment.
    script = f"{{ . {shlex.quote(setup)}; }} >&2; exec /usr/bin/env -0"
    answer = foreign([shell, "-c", script], dict(CLEAN, **activate(setup)), _SOURCING)
    if len(answer.output) > _LARGEST:
        return (
            {},
            f"The set-up file {quote(setup)} makes more than {_LARGEST >> 10} KiB of variables; expected those of ROS.",
        )
    variables = read_variables(answer.output)
    if answer.status == 0 and variables:
        return variables, ""
    error = quote(answer.last_error.rstrip(".")) or "it says nothing"
    return {}, explain_closed(
        [setup]
    ) or f"The set-up file {quote(setup)}, sourced by {shell}, sets no variables: {error}."


def activate(setup: str) -> typing.Dict[str, str]:
    """Return the variables that conda sets before it sources a set-up file in one of its environments; empty elsewhere.

    RoboStack's set-up file needs both: it asks the `python` of the environment, which looks at its own path.
    """
    folder = os.path.dirname(setup)
    if not os.path.isdir(os.path.join(folder, _OF_CONDA)):
        return {}
    return {CONDA: folder, "PATH": f"{folder}/bin:{BASE_PATH}"}


def read_variables(output: bytes) -> typing.Dict[str, str]:
    """Read the variables of a set-up file in the output of `env -0`; of PATH only the added entries.

    No environment file takes a value with a line break, another control character or bytes that are no UTF-8: it is left out.
    """
    variables = {}
    for name, value in processes.parse(output).items():
        if name in _OF_THE_SHELL or not _NAME.fullmatch(name) or not is_plain(value):
            continue
        if name in _LISTS:
            base = BASE_PATH.split(":") if name == "PATH" else []
            value = ":".join(item for item in value.split(":") if item and item not in base)
        if value:
            variables[name] = value
    return variables


def full(environment: typing.Dict[str, str]) -> typing.Dict[str, str]:
    """Make a whole environment for a process from the variables of a set-up file."""
    path = ":".join(filter(None, [environment.get("PATH", ""), BASE_PATH]))
    return dict(environment, **dict(CLEAN, PATH=path))


def hooks(environment: typing.Dict[str, str]) -> typing.Tuple[str, str]:
    """Return the folder of shell files that the prefix's set-up file sources at its end, or "" and the reason.

    Root writes there. So a folder that other users can replace, for example by a link, is passed over.
    """
    passed_over = ""
    for prefix in reversed(environment.get("CMAKE_PREFIX_PATH", "").split(":")):
        folder = os.path.join(prefix, HOOKS)
        if prefix.startswith("/") and os.path.isdir(folder):
            doubts = trust.TrustCheck().doubts(folder)
            if not doubts:
                return folder, ""
            passed_over = passed_over or f"below {quote(prefix)}, since {doubts[0].words}"
    return "", passed_over


def _import(setup: str, environment: typing.Dict[str, str]) -> Record:
    where = quote(setup) or "Debian's packages"
    tried = []
    for python in interpreters(environment):
        if not os.path.exists(python):
            return {
                "problem": f"The rospy of {where} is made for Python 2, but there is no {python}; install it (python2.7)."
            }
        tried.append((python, *try_import(python, MODULES, full(environment))))
        if tried[-1][1] and "rospy" not in tried[-1][2]:
            break
    else:
        del tried[1:]  # no Python has ROS, so the first one is as good as any
    python, version, missing, error = tried[-1]
    if not version:
        why = explain_closed([python]) or f"The modules of {where} cannot be imported: {quote(error)}."
        return {"python": python, "problem": why}
    result = {"python": python, "python_version": version, "missing": missing, "rospy": "rospy" not in missing}
    if missing:
        folders = [item for item in environment.get("PYTHONPATH", "").split(":") if os.path.isabs(item)]
        packages = ", ".join("python3-" + name.replace("_", "-") for name in missing)
        advice = "install the missing packages" if setup else f"install {packages}"
        result["problem"] = (
            explain_closed(folders)
            or f"{quote(python)} cannot import {', '.join(map(quote, missing))} out of {where}; {advice}."
        )
    return result


def interpreters(environment: typing.Dict[str, str]) -> typing.List[str]:
    """List the interpreters that a ROS may be made for, by its variables; the first that has its rospy is used.

    An environment of conda has one of its own, and that one comes first. Another prefix may have one too, such as a ROS that
    was built for a later Python than the system's: it is in the folders that the set-up file adds to PATH.
    """
    if environment.get("ROS_PYTHON_VERSION") == "2" or "/python2." in environment.get("PYTHONPATH", ""):
        return [PYTHON2]
    of_conda = shutil.which("python3", path=os.path.join(environment.get(CONDA) or "/nowhere", "bin"))
    added = shutil.which("python3", path=environment.get("PATH") or "/nowhere")
    return list(dict.fromkeys(python for python in (of_conda, PYTHON, added) if python))


def try_import(
    python: str, modules: typing.Sequence[str], environment: typing.Dict[str, str]
) -> typing.Tuple[str, typing.List[str], str]:
    """Let a user without rights import modules, as the services do; return the version of Python, the missing ones, and an error.

    The version is empty if there is no answer.
    """
    answer = foreign([python, "-c", _IMPORT, *modules], environment, _IMPORTING)
    result = last_line(answer.output)
    result = result if isinstance(result, dict) else {}
    version, missing = result.get("version"), result.get("missing")
    if not isinstance(version, str) or not _VERSION.fullmatch(version) or not isinstance(missing, list):
        return "", [], plain(answer.last_error or "no answer")
    return version, [name for name in modules if name in missing], ""


def explain_closed(paths: typing.Iterable[str]) -> str:
    """Explain in a sentence which folder or file on the way to these paths is closed to the user nobody; "" if all are open."""
    answer = run([PYTHON, "-I", "-c", _CLOSED] + [path for path in paths if os.path.exists(path)], user=find_nobody())
    part = answer.text.strip()
    if not part:
        return ""
    kind, right = ("folder", "x") if os.path.isdir(part) else ("file", "r")
    try:
        mode = os.stat(part).st_mode & 0o7777
    except (OSError, ValueError):  # it is gone meanwhile
        return ""
    return (
        f"The {kind} {quote(part)} (mode {mode:04o}) is closed to other users, but the services run as an unprivileged one: "
        f"open it (chmod o+{right} {quote(part)}), or use a ROS that is installed for everybody."
    )
