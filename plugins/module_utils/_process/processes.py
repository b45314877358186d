# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The readers of a process's environment and of its start, and the processes above this one."""

import os
import re
import time
import typing

from .commands import text

SSH_SERVERS = ("sshd", "sshd-session", "dropbear")  # sshd(8), sshd-session since OpenSSH 9.8, dropbear(8)
_MOST_ANCESTORS = 64


def ancestors(proc: str = "/proc") -> typing.Iterator[typing.Tuple[int, str, str]]:
    """This process's ancestors, the nearest first: their numbers, names and starts."""
    pid = os.getppid()
    for _generation in range(_MOST_ANCESTORS):
        # proc(5): pid (name) state parent ... start; a name may hold blanks and brackets
        fields = re.match(r"\d+ \((.*)\) \S (\d+) (?:\S+ ){17}(\d+) ", text(f"{proc}/{pid}/stat"), re.S)
        if fields is None:
            return
        name, parent, start = fields.groups()
        yield pid, name, start
        pid = int(parent)


def environment(pid: typing.Union[int, str], proc: str = "/proc") -> typing.Dict[str, str]:
    """Read the variables with which a process was started (proc(5), /proc/PID/environ).

    Raises OSError where the process has ended, or where this user may not look at it: root in a container may not.
    """
    with open(os.path.join(proc, str(pid), "environ"), "rb") as stream:
        return parse(stream.read())


def start_time(pid: typing.Union[int, str], proc: str = "/proc") -> typing.Optional[float]:
    """Return the Unix time at which a process was started (proc(5), /proc/PID/stat); None where it has ended."""
    try:
        with open(os.path.join(proc, str(pid), "stat"), "rb") as stream:
            fields = stream.read().rpartition(b")")[2].split()
        with open(os.path.join(proc, "uptime"), "rb") as stream:
            uptime = float(stream.read().split()[0])
    except (FileNotFoundError, NotADirectoryError, ProcessLookupError):
        return None
    return time.time() - uptime + int(fields[19]) / os.sysconf("SC_CLK_TCK")


def count_files(pid: typing.Union[int, str], proc: str = "/proc") -> typing.Optional[typing.Tuple[int, int]]:
    """Count the open files of a process, and return its limit, too (getrlimit(2), RLIMIT_NOFILE); None where this user may not look."""
    limit = file_limit(pid, proc)
    try:
        return (len(os.listdir(f"{proc}/{pid}/fd")), limit) if limit else None
    except OSError:
        return None


def file_limit(pid: typing.Union[int, str], proc: str = "/proc") -> int:
    """Return how many files a process may open (the soft limit of proc(5), /proc/PID/limits); 0 where it has ended."""
    line = re.search(r"^Max open files +(\d{1,19}) ", text(f"{proc}/{pid}/limits", 4096), re.MULTILINE)
    return int(line.group(1)) if line else 0


def is_stopped(pid: typing.Union[int, str], proc: str = "/proc") -> bool:
    """Say if a process is stopped by a signal or a debugger (proc(5), /proc/PID/stat); False where it has ended."""
    state = re.match(r"\d+ \(.*\) (\S)", text(f"{proc}/{pid}/stat"), re.S)
    return state is not None and state.group(1) in "Tt"


def parse(content: bytes) -> typing.Dict[str, str]:
    """Split the content of /proc/PID/environ; bytes that are no UTF-8 become surrogates, as in os.environ."""
    pairs = [entry.partition("=") for entry in content.decode("utf-8", "surrogateescape").split("\0")]
    return {name: value for name, equals, value in pairs if equals}
