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


class Stat(typing.NamedTuple):
    """The state of a process in /proc/PID/stat (proc(5))."""

    name: str
    state: str  # a letter
    parent: int
    start: str  # in ticks of the clock since the boot


def ancestors(proc: str = "/proc") -> typing.Iterator[typing.Tuple[int, str, str]]:
    """This process's ancestors, the nearest first: their numbers, names and starts."""
    pid = os.getppid()
    for _generation in range(_MOST_ANCESTORS):
        stat = _read_stat(pid, proc)
        if stat is None:
            return
        yield pid, stat.name, stat.start
        pid = stat.parent


def _read_stat(pid: typing.Union[int, str], proc: str) -> typing.Optional[Stat]:
    """Read the state of a process; None if it has ended, or if the text is cut off."""
    before, _bracket, after = text(f"{proc}/{pid}/stat").rpartition(")")  # a name may hold blanks and brackets
    words = after.split()
    if len(words) <= 20:  # the start is the word 19, and complete if another one follows
        return None
    return Stat(before.partition("(")[2], words[0], int(words[1]), words[19])


def find_parent(pid: int, proc: str = "/proc") -> int:
    """Return the number of the process that started another one; 0 if that has ended."""
    stat = _read_stat(pid, proc)
    return stat.parent if stat is not None else 0


def environment(pid: typing.Union[int, str], proc: str = "/proc") -> typing.Dict[str, str]:
    """Read the variables with which a process was started (proc(5), /proc/PID/environ).

    Raises OSError if the process has ended, or if this user may not look at it: root in a container may not.
    """
    with open(os.path.join(proc, str(pid), "environ"), "rb") as stream:
        return parse(stream.read())


def start_time(pid: typing.Union[int, str], proc: str = "/proc") -> typing.Optional[float]:
    """Return the Unix time at which a process was started; None if it has ended, or if no uptime can be read."""
    stat, uptime = _read_stat(pid, proc), text(f"{proc}/uptime").split()
    if stat is None or not uptime:
        return None
    return time.time() - float(uptime[0]) + int(stat.start) / os.sysconf("SC_CLK_TCK")


def count_files(pid: typing.Union[int, str], proc: str = "/proc") -> typing.Optional[typing.Tuple[int, int]]:
    """Count the open files of a process, and return its limit, too (getrlimit(2), RLIMIT_NOFILE); None if this user may not look."""
    limit = file_limit(pid, proc)
    try:
        return (len(os.listdir(f"{proc}/{pid}/fd")), limit) if limit else None
    except OSError:
        return None


def file_limit(pid: typing.Union[int, str], proc: str = "/proc") -> int:
    """Return how many files a process may open (the soft limit of proc(5), /proc/PID/limits); 0 if it has ended."""
    line = re.search(r"^Max open files +(\d{1,19}) ", text(f"{proc}/{pid}/limits", 4096), re.MULTILINE)
    return int(line.group(1)) if line else 0


def is_stopped(pid: typing.Union[int, str], proc: str = "/proc") -> bool:
    """Return True if a process is stopped by a signal or a debugger; False if it has ended."""
    stat = _read_stat(pid, proc)
    return stat is not None and stat.state in "Tt"


def parse(content: bytes) -> typing.Dict[str, str]:
    """Split the content of /proc/PID/environ; bytes that are no UTF-8 become surrogates, as in os.environ."""
    pairs = [entry.partition("=") for entry in content.decode("utf-8", "surrogateescape").split("\0")]
    return {name: value for name, equals, value in pairs if equals}
