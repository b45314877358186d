# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""Code of other people, such as a person's set-up file: it runs without rights, and its answer is not trusted."""

import json
import os
import shutil
import tempfile
import time
import typing
import uuid

from .commands import BASE_PATH, MOST, Answer, find_nobody, run

_LONGEST = 256 << 10  # bytes of a line of JSON: a number of some millions of digits would keep a processor for minutes

# Reads the command, since systemd would read `$` and `%` in a command line of its own.
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
# Of the sandbox of the services (plugin_utils/_plan/units.py). All processes end with it, also those with a session or
# group of their own.
SANDBOX = (
    "DynamicUser=yes",
    "PrivateTmp=yes",
    "ProtectHome=read-only",
    "PrivateDevices=yes",
    "ProtectKernelTunables=yes",
    "ProtectControlGroups=yes",
    "RestrictAddressFamilies=AF_INET AF_INET6 AF_UNIX AF_NETLINK",
    "CapabilityBoundingSet=",
)
_BOUNDS = ("KillSignal=SIGKILL", "MemoryMax=1G", "TasksMax=256", "LimitCORE=0", f"LimitFSIZE={MOST}")
_OVER = 10.0  # seconds that systemd has to start and to end a unit


def foreign(
    argv: typing.Sequence[str],
    variables: typing.Dict[str, str],
    limit: float,
    given: str = "",
    homes: typing.Sequence[str] = (),
) -> Answer:
    """Run code of other people, such as a person's set-up file. Its answer is foreign, too.

    Root runs it in a unit of systemd with a user of its own. The unit ends with all its processes after `limit` seconds.
    The variables `homes` name a folder of its own that it may write. Without systemd (preflight refuses such a machine)
    it runs as the user nobody, and a process that leaves its session may stay. Other users than root run it directly.
    """
    if not (os.geteuid() == 0 and os.path.isdir("/run/systemd/system") and shutil.which("systemd-run", path=BASE_PATH)):
        return _as_nobody(argv, variables, limit, given, homes)
    request = json.dumps([list(argv), dict(variables, **dict.fromkeys(homes, "/tmp")), given])
    unit = f"rosfleet-foreign-{uuid.uuid4().hex[:8]}.service"
    command = ["systemd-run", "--quiet", "--collect", "--wait", "--pipe", f"--unit={unit}"]
    command += [f"--property={line}" for line in SANDBOX + _BOUNDS + (f"RuntimeMaxSec={max(limit, 0.1):.1f}",)]
    began = time.monotonic()
    answer = run(command + ["--", _LAUNCHER, "-I", "-c", _LAUNCH], limit=limit + _OVER, given=request.encode())
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
            os.chown(folder, *find_nobody())
        variables = dict(variables, **dict.fromkeys(homes, folder))
        return run(argv, variables, limit, user=find_nobody(), given=given.encode("utf-8", "surrogateescape"))
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def last_line(output: bytes) -> typing.Any:
    """Read the JSON in the last line that foreign code wrote; None without JSON. Callers check its shape."""
    lines = output.rstrip().rsplit(b"\n", 1)
    if len(lines[-1]) > _LONGEST:
        return None
    try:
        return json.loads(lines[-1].decode("utf-8"))
    except (ValueError, RecursionError):
        return None
