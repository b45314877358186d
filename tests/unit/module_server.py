# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Modules as processes of their own, without the half second in which each would import Ansible.

One process imports Ansible once, and forks for each run: `run(name, arguments, namespace)` does what
`python -m NAME ARGUMENTS.json` does, in the network namespace of a file where one is given.
"""

import atexit
import contextlib
import ctypes
import functools
import json
import os
import runpy
import signal
import subprocess
import sys
import tempfile
import time
import traceback
from collections.abc import Sequence
from typing import IO, NamedTuple

from processes import with_paths

_PACKAGE = "ansible_collections.rosfleet.multimaster.plugins.modules"
_LIMIT = 60  # seconds of a run
_NETWORK = 0x40000000  # CLONE_NEWNET (setns(2))


class Done(NamedTuple):
    """The end of a module."""

    returncode: int
    stdout: str
    stderr: str


def command(name: str) -> list[str]:
    """The words that run a module of the collection as a program."""
    return [sys.executable, "-m", f"{_PACKAGE}.{name}"]


def run(name: str, arguments: dict, namespace: str = "") -> Done:
    """Run a module of the collection with the arguments of Ansible."""
    return at_once(name, [arguments], namespace)[0]


def at_once(name: str, many: list[dict], namespace: str = "", pauses: Sequence[float] = ()) -> list[Done]:
    """Run a module several times at once, with arguments for each; each begins so many seconds after the one before it."""
    server = _server()
    waits = [0.0, *pauses] if pauses else [0.0] * len(many)
    question = [
        [name, arguments, namespace, dict(os.environ), os.getcwd(), wait]
        for arguments, wait in zip(many, waits, strict=True)
    ]
    server.stdin.write(json.dumps(question) + "\n")
    server.stdin.flush()
    return [Done(*answer) for answer in json.loads(server.stdout.readline())]


@functools.cache
def _server() -> subprocess.Popen:
    environment = with_paths()
    server = subprocess.Popen(
        [sys.executable, __file__], env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    atexit.register(server.stdin.close)  # which ends it
    return server


def _serve() -> None:
    import ansible.module_utils.basic  # noqa: F401

    for line in sys.stdin:
        with contextlib.ExitStack() as stack:
            children = []
            for question in json.loads(line):
                output, error = (stack.enter_context(tempfile.TemporaryFile("w+")) for _stream in range(2))
                time.sleep(question.pop())
                child = os.fork()
                if child == 0:
                    _become(question, output.fileno(), error.fileno())
                children.append((child, output, error))
            print(json.dumps([_answer(*child) for child in children]), flush=True)


def _answer(child: int, *streams: IO[str]) -> list:
    status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    for stream in streams:
        stream.seek(0)
    return [status, *(stream.read() for stream in streams)]


def _become(question: list, output: int, error: int) -> None:
    """Be the module, and end."""
    name, arguments, namespace, environment, folder = question
    status = 1
    try:
        os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
        os.dup2(output, 1)
        os.dup2(error, 2)
        signal.alarm(_LIMIT)
        os.environ.clear()
        os.environ.update(environment)
        os.chdir(folder)
        if namespace:
            _enter(namespace)
        with tempfile.NamedTemporaryFile("w", suffix=".json") as given:
            json.dump({"ANSIBLE_MODULE_ARGS": arguments}, given)
            given.flush()
            sys.argv = [name, given.name]
            runpy.run_module(f"{_PACKAGE}.{name}", run_name="__main__", alter_sys=True)
        status = 0
    except SystemExit as end:
        status = end.code if isinstance(end.code, int) else int(end.code is not None)
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(status)


def _enter(namespace: str) -> None:
    descriptor = os.open(namespace, os.O_RDONLY | os.O_CLOEXEC)
    if ctypes.CDLL(None, use_errno=True).setns(descriptor, _NETWORK):
        raise OSError(ctypes.get_errno(), f"setns to {namespace}")
    os.close(descriptor)


if __name__ == "__main__":
    _serve()
