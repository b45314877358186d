# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The parts of multimaster_fkie or fkie_mas on this machine: executables of ROS packages, and Debian packages. Nothing is changed."""

import json
import os
import re
import typing

from .._base.commands import find_nobody, run
from .._base.foreign import foreign, last_line
from .._base.plain_text import LINE, plain, quote
from .._base.problem import Problem
from .._base.regular_files import read_regular

# The Debian packages that the collection installed, a name on each line; the role nodes writes it.
INSTALLED = "/etc/rosfleet-multimaster/packages"
_LOOKING = 60.0  # seconds; a workspace on a small computer, cold
_APT = 20.0  # seconds; 0.1 on a PC

PACKAGE = re.compile(r"[a-z0-9][a-z0-9+.-]{1,100}")
_PATH = re.compile(r"(?:/[A-Za-z0-9_.+-]+)+")

# Runs without rights, under the Python of ROS (2.7 or 3): looks as rosrun does, then imports.
_LOOK = """
import importlib, json, os, sys

def paths(name):
    return [item for item in os.environ.get(name, "").split(":") if os.path.isabs(item)]

def executable(package, name):
    for prefix in paths("CMAKE_PREFIX_PATH") + ["/usr"]:
        path = os.path.join(prefix, "lib", package, name)
        if os.path.isfile(path):
            return path
    for root in paths("ROS_PACKAGE_PATH"):
        for folder, folders, files in os.walk(root):
            if os.path.basename(folder) == package and "package.xml" in files:
                for part in ("nodes", "scripts"):
                    path = os.path.join(folder, part, name)
                    if os.path.isfile(path):
                        return path
            ends = "package.xml" in files or "CATKIN_IGNORE" in files
            folders[:] = [] if ends else sorted(entry for entry in folders if not entry.startswith("."))
    return ""

def lacks(programs):
    folders = paths("PATH")
    return [name for name in programs if not any(os.access(os.path.join(folder, name), os.X_OK) for folder in folders)]

def problem(modules):
    for name in modules:
        try:
            importlib.import_module(name)
        except BaseException as error:
            return "%s cannot be imported: %s: %s" % (name, type(error).__name__, error)
    return ""

found = []
for node in json.loads(sys.argv[1]):
    for name, value in node["environment"].items():
        os.environ.setdefault(name, value)
    path = executable(node["package"], node["executable"])
    if path and not os.access(path, os.R_OK):
        why = "%s is closed to other users" % path
    else:
        why = problem(node["modules"]) if path else ""
    found.append({"path": path, "problem": why, "lacks": lacks(node["programs"]) if path else []})
print("")
print(json.dumps(found))
"""


def nodes(
    wanted: typing.List[typing.Dict[str, typing.Any]], python: str, environment: typing.Dict[str, str]
) -> typing.List[typing.Dict[str, typing.Any]]:
    """Find each wanted executable of a ROS package: its path or "", the problem that keeps it from running, and programs that it lacks.

    `environment` is the whole environment of the services.
    """
    if not wanted:
        return []
    answer = foreign([python, "-c", _LOOK, json.dumps(wanted)], environment, _LOOKING)
    answers = last_line(answer.output)
    if not isinstance(answers, list) or len(answers) != len(wanted):
        why = plain(answer.last_error or "no answer")
        return [_node(node, "", why) for node in wanted]
    return [_check_answer(node, entry) for node, entry in zip(wanted, answers)]


def _check_answer(node: typing.Dict[str, typing.Any], entry: typing.Any) -> typing.Dict[str, typing.Any]:
    """Check the answer about a node: an imported module could print anything."""
    said = entry if isinstance(entry, dict) else {}
    path, problem, lacks = said.get("path"), said.get("problem"), said.get("lacks")
    if not isinstance(path, str) or not isinstance(problem, str):
        return _node(node, "", "the modules of the workspace gave an answer that cannot be read")
    if path and not _PATH.fullmatch(path):
        return _node(node, "", "its path is not absolute, or has other characters than letters, digits and _ . + -")
    if path and not os.path.isfile(path):
        return _node(node, "", f"{quote(path)} is no file")
    missing = [name for name in node["programs"] if isinstance(lacks, list) and name in lacks]
    return _node(node, path, plain(problem), missing)


def _node(
    node: typing.Dict[str, typing.Any], path: str, problem: str, lacks: typing.Sequence[str] = ()
) -> typing.Dict[str, typing.Any]:
    named = {"package": node["package"], "executable": node["executable"]}
    return dict(named, path=path, problem=problem, lacks=list(lacks))


def packages(wanted: typing.List[str], record: str = INSTALLED) -> typing.List[typing.Dict[str, typing.Any]]:
    """Look up the wanted Debian packages, and those that the collection installed: installed and available versions.

    Raises OSError if the record cannot be read, and Problem if apt does not answer.
    """
    lines = [line.strip() for line in read_record(record).splitlines()]
    ours = [line for line in lines if line and not line.startswith("#")]
    names = wanted + [name for name in ours if name not in wanted]
    versions: typing.Dict[str, typing.Dict[str, str]] = {}
    if names:
        # As nobody, so that not even apt's cache is written.
        answer = run(["apt-cache", "policy"] + names, limit=_APT, user=find_nobody())
        if answer.status != 0:
            reason = quote(answer.last_error, LINE) or f"status {answer.status}"
            raise Problem(
                f"apt-cache policy failed ({reason}), so it is not known which packages are installed; expected an answer: run it on "
                "this computer by hand."
            )
        versions = policy(answer.text)
    nothing = {"installed": "", "candidate": ""}
    return [dict(versions.get(name, nothing), name=name, ours=name in ours) for name in names]


def policy(output: str) -> typing.Dict[str, typing.Dict[str, str]]:
    """Read {package: versions} in the output of apt-cache policy, without packages that apt does not know."""
    versions: typing.Dict[str, typing.Dict[str, str]] = {}
    name = ""
    for line in output.splitlines():
        word, colon, value = line.strip().partition(":")
        if line and not line[0].isspace():
            name = word
            versions[name] = {"installed": "", "candidate": ""}
        elif name and colon and word.lower() in versions[name] and value.strip() != "(none)":
            versions[name][word.lower()] = value.strip()
    return versions


def read_record(path: str) -> str:
    """Read the record of the packages that the collection installed. A missing file is an empty text. Raises OSError."""
    try:
        return read_regular(path).decode("utf-8", "replace")
    except (FileNotFoundError, NotADirectoryError):
        return ""
