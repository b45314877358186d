# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""A run of a module whose process is kept for the next run of the same module, and does it when it is asked at its door.

The start of a module takes most computers more than its work: Python starts, Ansible's part and ours come as sources and
are compiled. All of that is there already in a process that has done it. Where it is gone, the module is started as usual.
"""

import errno
import functools
import importlib
import io
import json
import linecache
import select
import socket
import struct
import sys
import traceback
import typing
import zipfile

from ansible.module_utils import basic
from ansible.module_utils.common import warnings
from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine.left_behind import (
    admit,
    end_others,
    leave,
    open_door,
    path_of,
    put_away,
)

KIND = "kept"  # the beginning of the door's name
REQUEST = "run"  # the options of the next run, in the request of the action
_SENDING = 60.0  # seconds for the answer, which goes to the controller over whatever network there is
_asker = 0  # the process that asked for the present run
_SHIPPED = ("ansible/module_utils/", "ansible_collections/rosfleet/multimaster/plugins/module_utils/")

Options = typing.Dict[str, typing.Any]


def asker() -> int:
    """Return the process id of who asked for this run at the door; 0 in a run that was started as usual."""
    return _asker


def keep(main: typing.Callable[[], None], run: str, seconds: float) -> None:
    """Keep this process for one more run of `main`, at most for so many seconds. Where that cannot be, nothing is lost.

    `run` is the label by which the controller finds it.
    """
    path = path_of(KIND, run)
    try:
        door = _opened(path)
    except OSError:
        return
    with door:
        try:
            load(getattr(__spec__.loader, "archive", ""))
            leave(functools.partial(serve, door, path, main, seconds), [door], "A kept run of rosfleet.multimaster")
        except Exception:  # no memory, no process: the next run is started as usual
            put_away(path)


def _opened(path: str) -> socket.socket:
    """Open the door. One of the same name is of a process that was killed, or waits for nobody any more. Raises OSError."""
    try:
        return open_door(path)
    except OSError as problem:
        if problem.errno != errno.EADDRINUSE:
            raise
    end_others(KIND)
    return open_door(path)


def load(archive: str) -> None:
    """Import what came in the archive of the module, and keep the sources: it is removed at the end of the run.

    Imports may come later, and some code is handed on as source.
    """
    if not archive:
        return
    with zipfile.ZipFile(archive) as shipped:
        names = [name for name in shipped.namelist() if name.startswith(_SHIPPED) and name.endswith(".py")]
    for name in names:
        try:
            module = importlib.import_module(name[: -len(".py")].replace("/__init__", "").replace("/", "."))
        except ImportError:
            continue  # the run says it, if it needs that one
        linecache.getlines(module.__file__ or "", vars(module))


def serve(door: socket.socket, path: str, main: typing.Callable[[], None], seconds: float) -> None:
    """Wait for the one visitor, and do what it asks for."""
    try:
        if not select.select([door], [], [], seconds)[0]:
            return
        connection, request = admit(door)
    finally:
        put_away(path)
    with connection:
        options = request.get(REQUEST)
        if isinstance(options, dict):
            global _asker  # pylint: disable=global-statement
            _asker = process_of(connection)
            try:
                found = result(main, options)
            except Exception as problem:  # a module that is started would show it as well
                what = traceback.format_exc()
                found = {
                    "failed": True,
                    "msg": f"The run of the module ended by an error: {problem!r}.",
                    "exception": what,
                }
            said = json.dumps(found).encode()
            connection.settimeout(_SENDING)
            connection.sendall(said + b"\n")


def process_of(connection: socket.socket) -> int:
    """Return the id of the process at the other end, as the kernel says it (SO_PEERCRED, unix(7))."""
    size = struct.calcsize("3i")
    return int(struct.unpack("3i", connection.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, size))[0])


def result(main: typing.Callable[[], None], options: Options) -> Options:
    """Run a module once more, with these options; returns what it writes for Ansible. Raises ValueError where that is nothing."""
    former = json.loads(basic._ANSIBLE_ARGS)["ANSIBLE_MODULE_ARGS"]
    of_ansible = {name: value for name, value in former.items() if name.startswith("_ansible_")}
    basic._ANSIBLE_ARGS = json.dumps({"ANSIBLE_MODULE_ARGS": dict(of_ansible, **options)}).encode()
    for told in ("_global_warnings", "_global_deprecations"):  # by the first run
        getattr(warnings, told, []).clear()
    sys.stdout = written = io.StringIO()
    try:
        main()
    except SystemExit:
        pass  # the end of every module
    finally:
        sys.stdout = sys.__stdout__
    found: Options = json.loads(written.getvalue())
    return found
