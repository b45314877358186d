# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""Commands, functions and files of this machine, each with a limit of time or of size."""

import contextlib
import os
import pwd
import resource
import signal
import subprocess
import tempfile
import threading
import types
import typing

from .problem import explain_error
from .regular_files import read_regular

BASE_PATH = "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin"
CLEAN = {"PATH": BASE_PATH, "HOME": "/", "LC_ALL": "C.UTF-8"}
_LIMIT = 30.0  # seconds; commands here answer in hundredths, and on a very busy machine in seconds
_NOBODY = 65534
MOST = 4 << 20  # bytes of a command's output
_MOST_ERRORS = 1 << 16  # bytes of its errors, the last ones


class Answer(typing.NamedTuple):
    """The end of a command: its exit status (-1: none), its output on stdout, and that on stderr."""

    status: int
    output: bytes
    error: str

    @property
    def text(self) -> str:
        """The output as text."""
        return self.output.decode("utf-8", "replace")

    @property
    def last_error(self) -> str:
        """The last line of the errors, empty if the command wrote no error."""
        return (self.error.splitlines() or [""])[-1]


def run(
    argv: typing.Sequence[str],
    environment: typing.Optional[typing.Dict[str, str]] = None,
    limit: float = _LIMIT,
    given: bytes = b"",
    user: typing.Optional[typing.Tuple[int, int]] = None,
) -> Answer:
    """Run a command in a clean environment for at most `limit` seconds, then end all its processes.

    Root becomes the `user` (uid, gid) first, if one is given; `given` is the input of the command.
    No exception: a missing or slow command gives an Answer with the status -1 and a sentence as its error.
    """
    # Without a preexec_fn, Python from 3.10 on uses vfork. A copy of this process costs more than most commands.
    become = _become(user) if user and os.geteuid() == 0 else None
    try:
        return _run(argv, CLEAN if environment is None else environment, limit, given, become)
    except (OSError, ValueError, subprocess.SubprocessError) as problem:  # ValueError: a word with a NUL
        return Answer(-1, b"", f"{argv[0]} could not be started: {explain_error(problem)}")


def _run(
    argv: typing.Sequence[str],
    environment: typing.Dict[str, str],
    limit: float,
    given: bytes,
    become: typing.Optional[typing.Callable[[], None]],
) -> Answer:
    """Run a command. Raises an exception if it cannot be started, also for want of room for its output."""
    # Files instead of pipes: a process that the command leaves in the background holds no pipe that we wait for.
    with tempfile.TemporaryFile() as output, tempfile.TemporaryFile() as error, tempfile.TemporaryFile() as question:
        question.write(given)
        question.seek(0)
        process = subprocess.Popen(
            argv,
            env=environment,
            cwd="/",
            stdin=question,
            stdout=output,
            stderr=error,
            start_new_session=True,
            preexec_fn=become,
        )
        late = threading.Event()
        # The time limit of subprocess polls, up to 0.05 s apart, for each command.
        timer = threading.Timer(limit, _end_late, (process.pid, late))
        timer.daemon = True
        timer.start()
        status = process.wait()
        timer.cancel()
        _end(process.pid)
        if late.is_set():
            return Answer(-1, b"", f"{argv[0]} gave no answer within {limit:g} s")
        output.seek(0)
        error.seek(max(0, os.fstat(error.fileno()).st_size - _MOST_ERRORS))
        return Answer(status, output.read(MOST), error.read(_MOST_ERRORS).decode("utf-8", "replace").strip())


def _end(group: int) -> None:
    """End the remaining processes of a group."""
    with contextlib.suppress(ProcessLookupError):
        os.killpg(group, signal.SIGKILL)


def _end_late(group: int, late: threading.Event) -> None:
    late.set()
    _end(group)


def find_nobody() -> typing.Tuple[int, int]:
    """The (uid, gid) of the user nobody, which has no rights."""
    try:
        entry = pwd.getpwnam("nobody")
        return entry.pw_uid, entry.pw_gid
    except KeyError:
        return _NOBODY, _NOBODY


def _become(who: typing.Tuple[int, int]) -> typing.Callable[[], None]:
    """Return the steps of a child between fork(2) and exec(2): system calls only, since other threads may hold any lock."""

    def become() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (MOST, MOST))
        os.setgroups([])
        os.setgid(who[1])
        os.setuid(who[0])

    return become


def text(path: str, most: int = 1 << 20) -> str:
    """Read the text of a regular file, at most `most` bytes of it; empty if it cannot be read."""
    try:
        return read_regular(path, most).decode("utf-8", "replace")
    except (OSError, ValueError):  # ValueError: a path with a NUL
        return ""


def read_source(module: types.ModuleType) -> str:
    """Read the source of a module of ours, which another process is to run. Raises ImportError without a source.

    The loader is asked, since `inspect` keeps lines in a cache that threads take from each other: where modules come
    from an archive, as on a robot, one of two threads finds no source at times.
    """
    spec: typing.Any = module.__spec__
    source = spec.loader.get_source(spec.name)
    if source is None:
        raise ImportError(f"{spec.name} has no source")
    return str(source)
