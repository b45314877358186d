# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""Commands, functions and files of this machine, each with a limit of time or of size."""

import json
import os
import pwd
import resource
import shutil
import signal
import subprocess
import tempfile
import threading
import time
import typing
import uuid

from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine.reading import read_regular

BASE_PATH = "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin"
CLEAN = {"PATH": BASE_PATH, "HOME": "/", "LC_ALL": "C.UTF-8"}
_LIMIT = 5.0  # seconds; every command asked here answers in a few hundredths
_NOBODY = 65534
MOST = 4 << 20  # bytes of a command's output
_LONGEST = 256 << 10  # bytes of a line of JSON: a number of some millions of digits would keep a processor for minutes
_SAID = 1 << 16  # bytes of its errors, the last ones


class Answer(typing.NamedTuple):
    """The end of a command: its exit status (-1: none), what it wrote to stdout, and what it wrote to stderr."""

    status: int
    output: bytes
    error: str


def run(
    argv: typing.Sequence[str],
    environment: typing.Optional[typing.Dict[str, str]] = None,
    limit: float = _LIMIT,
    unprivileged: bool = False,
    given: bytes = b"",
    user: typing.Optional[typing.Tuple[int, int]] = None,
) -> Answer:
    """Run a command in a clean environment for at most `limit` seconds, then end all its processes.

    With `unprivileged`, root becomes the user nobody first, or `user` (uid, gid); `given` is what it reads. No exception:
    a command that does not exist, or is too slow, gives an Answer with the status -1 and a sentence as its error.
    """
    become = os.setsid
    if (unprivileged or user) and os.geteuid() == 0:
        become = _become(user or _nobody())
    # Files instead of pipes: a process that the command leaves in the background holds no pipe that we wait for.
    with tempfile.TemporaryFile() as output, tempfile.TemporaryFile() as error, tempfile.TemporaryFile() as question:
        question.write(given)
        question.seek(0)
        try:
            process = subprocess.Popen(
                argv,
                env=CLEAN if environment is None else environment,
                cwd="/",
                stdin=question,
                stdout=output,
                stderr=error,
                preexec_fn=become,
            )
        except (OSError, subprocess.SubprocessError) as problem:
            return Answer(-1, b"", f"{argv[0]} could not be started: {problem}")
        try:
            status = process.wait(timeout=limit)
        except subprocess.TimeoutExpired:
            status = -1
        try:
            os.killpg(process.pid, signal.SIGKILL)
        except ProcessLookupError:
            pass
        process.wait()
        if status == -1:
            return Answer(-1, b"", f"{argv[0]} gave no answer within {limit:g} s")
        output.seek(0)
        error.seek(max(0, os.fstat(error.fileno()).st_size - _SAID))
        return Answer(status, output.read(MOST), error.read(_SAID).decode("utf-8", "replace").strip())


# Code of somebody else's

# Reads what to run, since systemd would read `$` and `%` in a command line of its own.
_LAUNCH = """
import json, os, sys, tempfile
argv, variables, given = json.load(sys.stdin)
def coded(text):
    return text.encode("utf-8", "surrogateescape")
question = tempfile.TemporaryFile()
question.write(coded(given))
question.seek(0)
os.dup2(question.fileno(), 0)
os.execvpe(coded(argv[0]), [coded(word) for word in argv], {coded(name): coded(variables[name]) for name in variables})
"""
_LAUNCHER = "/usr/bin/python3"
# The sandbox of the services. What it starts ends with it, whatever session or group that made for itself.
_SANDBOX = (
    "DynamicUser=yes",
    "PrivateTmp=yes",
    "ProtectHome=read-only",
    "PrivateDevices=yes",
    "ProtectKernelTunables=yes",
    "ProtectControlGroups=yes",
    "RestrictAddressFamilies=AF_INET AF_INET6 AF_UNIX AF_NETLINK",
    "CapabilityBoundingSet=",
    "KillSignal=SIGKILL",
    "MemoryMax=1G",
    "TasksMax=256",
    "LimitCORE=0",
    f"LimitFSIZE={MOST}",
)
_OVER = 10.0  # seconds that systemd has to start and to end a unit


def foreign(
    argv: typing.Sequence[str],
    variables: typing.Dict[str, str],
    limit: float,
    given: str = "",
    homes: typing.Sequence[str] = (),
) -> Answer:
    """Run code of somebody else's: a person's set-up file, or what it leads to. Its answer is to be judged as theirs.

    Root runs it in a unit of systemd with a user of its own, which ends with all its processes after `limit` seconds at
    most. The variables `homes` name a folder of its own that it may write. Without systemd, where preflight refuses the
    machine, it is the user nobody, and a process that leaves its session may stay. Who is not root runs it as it is.
    """
    if not (os.geteuid() == 0 and os.path.isdir("/run/systemd/system") and shutil.which("systemd-run", path=BASE_PATH)):
        return _as_nobody(argv, variables, limit, given, homes)
    told = json.dumps([list(argv), dict(variables, **dict.fromkeys(homes, "/tmp")), given])
    unit = f"rosfleet-foreign-{uuid.uuid4().hex[:8]}.service"
    command = ["systemd-run", "--quiet", "--collect", "--wait", "--pipe", f"--unit={unit}"]
    command += [f"--property={line}" for line in _SANDBOX + (f"RuntimeMaxSec={max(limit, 0.1):.1f}",)]
    began = time.monotonic()
    answer = run(command + ["--", _LAUNCHER, "-I", "-c", _LAUNCH], limit=limit + _OVER, given=told.encode())
    if answer.status == -1:
        run(["systemctl", "stop", unit], limit=_OVER)
    late = answer.status != 0 and time.monotonic() - began >= limit
    return Answer(-1, b"", f"{argv[0]} gave no answer within {limit:g} s") if late else answer


def _as_nobody(
    argv: typing.Sequence[str],
    variables: typing.Dict[str, str],
    limit: float,
    given: str,
    homes: typing.Sequence[str],
) -> Answer:
    folder = tempfile.mkdtemp(prefix="rosfleet-foreign-")
    try:
        if os.geteuid() == 0:
            os.chown(folder, *_nobody())
        variables = dict(variables, **dict.fromkeys(homes, folder))
        return run(argv, variables, limit, unprivileged=True, given=given.encode("utf-8", "surrogateescape"))
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _nobody() -> typing.Tuple[int, int]:
    try:
        entry = pwd.getpwnam("nobody")
        return entry.pw_uid, entry.pw_gid
    except KeyError:
        return _NOBODY, _NOBODY


def _become(who: typing.Tuple[int, int]) -> typing.Callable[[], None]:
    """Return the steps of a child between fork(2) and exec(2): system calls only, since other threads may hold any lock."""

    def become() -> None:
        os.setsid()
        resource.setrlimit(resource.RLIMIT_FSIZE, (MOST, MOST))
        os.setgroups([])
        os.setgid(who[1])
        os.setuid(who[0])

    return become


def last_line(output: bytes) -> typing.Any:
    """Read the JSON in the last line that foreign code wrote; None where there is none. Its shape is still unknown."""
    lines = output.rstrip().rsplit(b"\n", 1)
    if len(lines[-1]) > _LONGEST:
        return None
    try:
        return json.loads(lines[-1].decode("utf-8"))
    except (ValueError, RecursionError):
        return None


def within(limit: float, function: typing.Callable[..., typing.Any], *arguments: typing.Any) -> typing.Any:
    """Call a function; raise TimeoutError after `limit` seconds, since a file on a dead network disk blocks."""
    results: typing.List[typing.Tuple[bool, typing.Any]] = []

    def work() -> None:
        try:
            results.append((True, function(*arguments)))
        except Exception as problem:  # handed to the caller, who is another thread
            results.append((False, problem))

    thread = threading.Thread(target=work)
    thread.daemon = True  # a blocked one does not keep the process
    thread.start()
    thread.join(limit)
    if not results:
        raise TimeoutError(f"no answer within {limit:g} s")
    good, value = results[0]
    if good:
        return value
    raise value


def text(path: str, most: int = 1 << 20) -> str:
    """Read the text of a regular file, at most `most` bytes of it; empty where there is none to read."""
    try:
        return read_regular(path, most).decode("utf-8", "replace")
    except (OSError, ValueError):  # ValueError: a path with a NUL
        return ""
