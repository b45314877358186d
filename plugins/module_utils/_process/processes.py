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
_NAME, _STATE, _PARENT, _START = 0, 1, 2, 20  # places in what _read_stat returns


def ancestors(proc: str = "/proc") -> typing.Iterator[typing.Tuple[int, str, str]]:
    """This process's ancestors, the nearest first: their numbers, names and starts."""
    pid = os.getppid()
    for _generation in range(_MOST_ANCESTORS):
        fields = _read_stat(pid, proc)
        if not fields:
            return
        yield pid, fields[_NAME], fields[_START]
        pid = int(fields[_PARENT])


def _read_stat(pid: typing.Union[int, str], proc: str) -> typing.List[str]:
    """Read the name of a process and what follows it (proc(5), /proc/PID/stat); nothing where it has ended."""
    before, bracket, after = text(f"{proc}/{pid}/stat").rpartition(")")  # a name may hold blanks and brackets
    return [before.partition("(")[2], *after.split()] if bracket else []


def environment(pid: typing.Union[int, str], proc: str = "/proc") -> typing.Dict[str, str]:
    """Read the variables with which a process was started (proc(5), /proc/PID/environ).

    Raises OSError where the process has ended, or where this user may not look at it: root in a container may not.
    """
    with open(os.path.join(proc, str(pid), "environ"), "rb") as stream:
        return parse(stream.read())


def start_time(pid: typing.Union[int, str], proc: str = "/proc") -> typing.Optional[float]:
    """Return the Unix time at which a process was started (proc(5), /proc/PID/stat); None where it has ended."""
    fields = _read_stat(pid, proc)
    if not fields:
        return None
    uptime = float(text(f"{proc}/uptime").split()[0])
    return time.time() - uptime + int(fields[_START]) / os.sysconf("SC_CLK_TCK")


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
    fields = _read_stat(pid, proc)
    return bool(fields) and fields[_STATE] in "Tt"


def parse(content: bytes) -> typing.Dict[str, str]:
    """Split the content of /proc/PID/environ; bytes that are no UTF-8 become surrogates, as in os.environ."""
    pairs = [entry.partition("=") for entry in content.decode("utf-8", "surrogateescape").split("\0")]
    return {name: value for name, equals, value in pairs if equals}
