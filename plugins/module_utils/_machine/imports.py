# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The proof that a user without rights can import modules of Python, kept until a file that it read has changed.

The import of rospy takes a computer more than all else of a look. So what was proved is kept in /run, with the state of
all files and folders that were read, and counts while each of them is the same. Only what root alone can change proves
anything for the next time: code of a person may do something else then.
"""

import glob
import json
import os
import re
import time
import typing

from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine import trust
from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine.foreign import foreign, last_line
from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine.plain_text import is_plain, plain
from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine.reading import read_regular

PROOF = "/run/rosfleet-multimaster/imports.json"
_MOST = 4000  # paths of a proof; those of ROS are some 500
_LARGEST = 4 << 20  # bytes of a proof
_IMPORTING = 20.0  # seconds; 0.4 on a PC, cold on a small robot several
_SETTLED = 10**9  # nanoseconds; the clock of files is coarser than that of processes
_VERSION = re.compile(r"[23]\.[0-9]{1,3}\.[0-9]{1,3}")
_OF_THE_SANDBOX = ("/tmp", "/var/tmp", "/proc", "/dev")  # another one there than here
_OF_THE_LOADER = ("/etc/ld.so.cache", "/etc/ld.so.preload")  # where it finds libraries (ld.so(8))

_ASK = """
import importlib, json, os, sys
missing = []
for name in sys.argv[1:]:
    try:
        importlib.import_module(name)
    except Exception:
        missing.append(name)

def read():
    found = set()
    for module in list(sys.modules.values()):
        parts = getattr(module, "__dict__", {})  # Python 2 has None for some
        file, cached = parts.get("__file__"), parts.get("__cached__")
        for path in (file, cached, file[:-1] if str(file).endswith((".pyc", ".pyo")) else None):
            if isinstance(path, str) and os.path.isabs(path):
                found.update((path, os.path.dirname(path)))
        for folder in list(parts.get("__path__") or ()):
            found.update((folder, os.path.join(folder, "__init__.py")))
    for folder in map(os.path.abspath, sys.path):
        found.add(folder)
        if os.path.isdir(folder) and os.access(folder, os.R_OK):
            found.update(os.path.join(folder, name) for name in os.listdir(folder) if name.endswith(".pth"))
    with open("/proc/self/maps") as maps:
        found.update(line.split(None, 5)[5].rstrip("\\n") for line in maps if len(line.split(None, 5)) == 6)
    return sorted(path for path in found if path.startswith("/"))

answer = {"version": "%d.%d.%d" % sys.version_info[:3], "missing": missing, "read": None}
try:
    text = json.dumps(dict(answer, read=read()))
except Exception:
    text = ""
print()
print(text if 0 < len(text) < 200000 else json.dumps(answer))
"""

_TIMES = 5  # where size and times begin in a state
State = typing.Optional[typing.List[int]]  # of a file or folder; None where there is none


class Imported(typing.NamedTuple):
    """An import that was tried: the version of Python ("" for no answer), the modules that are missing, and what was said."""

    version: str
    missing: typing.List[str]
    said: str = ""


def tried(
    python: str, modules: typing.Sequence[str], environment: typing.Dict[str, str], proof: str = "", keep: bool = False
) -> Imported:
    """Let a user without rights import modules, or say what that gave the last time where nothing has changed since.

    `proof` is the file of the last time, "" for code that others than root can change; with `keep` it is written.
    """
    asked = {"python": python, "modules": list(modules), "environment": environment, "program": _ASK}
    before = _proved(proof, asked) if proof else ""
    if before:
        return Imported(before, [])
    began = int(time.time() * 1e9)
    answer = foreign([python, "-c", _ASK, *modules], environment, _IMPORTING)
    told = last_line(answer.output)
    told = told if isinstance(told, dict) else {}
    version, missing = told.get("version"), told.get("missing")
    if not isinstance(version, str) or not _VERSION.fullmatch(version) or not isinstance(missing, list):
        return Imported("", [], plain((answer.error.splitlines() or ["no answer"])[-1]))
    if proof and keep and not missing:
        _keep(proof, dict(asked, version=version), told.get("read"), began)
    return Imported(version, [name for name in modules if name in missing])


def forget(proof: str = PROOF) -> None:
    """Remove what was proved, what is compiled (_archive/once.py), what killed runs left of both, and the folder if that is empty."""
    folder = os.path.dirname(proof)
    for beginning in (proof, os.path.join(folder, "compiled-")):
        for path in glob.glob(glob.escape(beginning) + "*"):
            _remove(os.unlink, path)
    _remove(os.rmdir, folder)


def _remove(remove: typing.Callable[[str], None], path: str) -> None:
    try:
        remove(path)
    except OSError:
        pass  # it is not there, or the folder holds more


def _proved(proof: str, asked: typing.Dict[str, typing.Any]) -> str:
    """Return the version of Python that has proved it, if nothing has changed since; else nothing."""
    try:
        if os.lstat(proof).st_uid != os.geteuid():
            return ""
        kept = json.loads(read_regular(proof, _LARGEST).decode())
        same = {name: kept[name] for name in asked} == asked and _states(kept["read"]) == kept["states"]
        return str(kept["version"]) if same else ""
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return ""  # there is none, or none that this version has written


def _keep(proof: str, proved: typing.Dict[str, typing.Any], told: typing.Any, began: int) -> None:
    """Keep a proof, unless something that was read is in other hands, is not to be seen from here, or changed meanwhile."""
    if not _are_paths(told):
        return
    libraries = proved["environment"].get("LD_LIBRARY_PATH", "").split(":")
    own = [proved["python"], *_OF_THE_LOADER, *(folder for folder in libraries if folder.startswith("/"))]
    read = sorted({*told, *own})
    if any(path == top or path.startswith(top + "/") for path in read for top in _OF_THE_SANDBOX):
        return
    look = trust.Look(os.geteuid())
    if any(look.doubts(path) for path in read):
        return
    aside = f"{proof}.{os.getpid()}"
    try:
        states = _states(read)
        if any(state and max(state[_TIMES + 1 :], default=0) > began - _SETTLED for state in states.values()):
            return
        os.makedirs(os.path.dirname(proof), 0o755, exist_ok=True)
        with open(os.open(aside, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w", encoding="utf-8") as file:
            json.dump(dict(proved, read=read, states=states), file)
        os.rename(aside, proof)
    except (OSError, ValueError):  # a full disk, or a name that is no text here: the next look tries it again
        _remove(os.unlink, aside)


def _are_paths(read: typing.Any) -> bool:
    if not isinstance(read, list) or len(read) > _MOST:
        return False
    return all(isinstance(path, str) and path.startswith("/") and is_plain(path, 4096) for path in read)


def _states(paths: typing.Iterable[str]) -> typing.Dict[str, State]:
    """Return the states of these files and folders, and of the folders on the way to them: who closes one of these counts."""
    states = {path: _state(path) for path in paths}
    for path in [*states, *map(os.path.realpath, list(states))]:
        for folder in _on_the_way(path):
            if folder not in states:
                state = _state(folder)
                states[folder] = state and state[:_TIMES]  # what else is in it does not count
    return states


def _on_the_way(path: str) -> typing.Iterator[str]:
    while path != os.path.dirname(path):
        path = os.path.dirname(path)
        yield path


def _state(path: str) -> State:
    """Return what tells a file or folder from any other, and from itself after a change (inode(7))."""
    try:
        found = os.stat(path)
    except OSError:
        return None
    who = [found.st_dev, found.st_ino, found.st_mode, found.st_uid, found.st_gid]
    return [*who, found.st_size, found.st_mtime_ns, found.st_ctime_ns]
