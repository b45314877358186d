# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""Resources that programs of this computer depend on: a clock that is kept right, room to write, limits of open files, names in containers."""

import ctypes
import os
import re
import typing

from ..._base import processes
from ..._base.commands import text
from ..._base.plain_text import LINE, plain
from ..._base.regular_files import read_regular
from ..._contract.computer import Disk, FullProcess
from ..._machine import ports

UNSYNCHRONISED = 5  # TIME_ERROR of adjtimex(2)
TIMEX = 1024  # bytes, more than struct timex has anywhere; all zero, it only asks
# The folders in which programs of ROS and services write, besides the state of the services themselves.
FOLDERS = ("/var/lib", "/var/log", "/tmp", "/run")
STATE = "/var/lib/private/multimaster-{}"
# An accept of libxmlrpcpp takes 8 bytes for each file that its process may open (XmlRpcServer::countFreeFDs).
MOST_FILES = 1 << 20  # as containers have it
MOST_NODES = 20  # that are listed
CONFINED = 16  # a program with a smaller limit has given it to itself, as sshd before a login
_MOST_HOSTS = 1 << 20  # bytes of a file of names
_STARTERS = re.compile(r"(?:user@\d+|sshd?(?:@.*)?|getty@.*|cron)\.service\Z")  # their limit is that of a shell

Row = typing.Dict[str, typing.Any]


def clock() -> typing.Dict[str, typing.Optional[bool]]:
    """Return True if something keeps the clock right, such as chrony, as the kernel knows it; None if it does not report that."""
    try:
        state = ctypes.CDLL(None).adjtimex(ctypes.create_string_buffer(TIMEX))
    except (OSError, AttributeError):  # no such function in this C library
        return {"synchronised": None}
    return {"synchronised": None if state < 0 else state != UNSYNCHRONISED}


def disks(services: typing.Sequence[str], folders: typing.Sequence[str] = FOLDERS) -> typing.List[Row]:
    """Count the room that others than root have on the disks of services; each file system once, by the first of its folders."""
    found: typing.Dict[int, Row] = {}
    for path in [STATE.format(service) for service in services] + list(folders):
        try:
            device, there = os.stat(path).st_dev, os.statvfs(path)
        except OSError:
            continue  # it is not there; no program writes there
        free_files = there.f_favail if there.f_files else None  # some file systems do not count them
        found.setdefault(device, Disk(path, free_bytes=there.f_bavail * there.f_frsize, free_files=free_files).plain())
    return list(found.values())


def file_limits() -> typing.List[Row]:
    """List processes of ROS that may open more than MOST_FILES files, once for each unit, and at most MOST_NODES of them.

    A process of ROS has ROS_MASTER_URI, or the name of a node among its words, and listens, as each node does. Limits are
    read first, since few processes have such a one.
    """
    listens = {entry.inode for entry in ports.read_sockets("tcp", "/proc") if entry.state == ports.LISTEN}

    def look(pid: int) -> typing.Optional[Row]:
        limit = processes.file_limit(pid)
        if limit <= MOST_FILES or pid == os.getpid():
            return None
        named = any(word.startswith("__name:=") for word in _read_words(pid, "/proc"))
        of_ros = named or "ROS_MASTER_URI" in processes.environment(pid)
        if not of_ros or listens.isdisjoint(ports.list_inodes(pid, "/proc")):
            return None
        unit, person = _unit_of(pid, "/proc")
        is_service = unit.endswith(".service") and not _STARTERS.match(unit)
        return {"limit": limit, "unit": unit if is_service else "", "person": person if is_service else ""}

    return _list_nodes(look, "/proc")


def full_processes(proc: str = "/proc") -> typing.List[Row]:
    """List processes that may open no file more, or one: their kernel takes connections, and they do not (accept(2), EMFILE)."""
    found = []
    for pid in sorted(int(name) for name in os.listdir(proc) if name.isdigit()):
        counted = processes.count_files(pid, proc)
        if counted is None or counted[1] - counted[0] > 1 or counted[1] < CONFINED:
            continue
        try:
            name = _name_of(pid, proc)
        except OSError:  # it has ended
            continue
        unit, person = _unit_of(pid, proc)
        found.append(FullProcess(name, pid, unit, *counted, person=person).plain())
        if len(found) == MOST_NODES:
            break
    return found


def container_names(names: typing.Iterable[str], proc: str = "/proc", hosts: str = "/etc/hosts") -> typing.List[Row]:
    """List containers with processes of ROS whose /etc/hosts lacks some of these names that this computer's has, at most MOST_NODES.

    A container has a copy from the moment of its start, which may be before the fleet's names came. Its other contents are not
    reported: a stranger may have made it.
    """
    wanted = _read_hosts(hosts) & {name.lower() for name in names}

    def look(pid: int) -> typing.Optional[Row]:
        folder = os.path.join(proc, str(pid))
        contained = ports.is_contained(text(os.path.join(folder, "status")))
        if not contained or "ROS_MASTER_URI" not in processes.environment(pid, proc):
            return None
        missing = wanted - _read_hosts(os.path.join(folder, "root/etc/hosts"))
        return {"missing": sorted(missing), "unit": _unit_of(pid, proc)[0]} if missing else None

    return _list_nodes(look, proc) if wanted else []


def _list_nodes(look: typing.Callable[[int], typing.Optional[Row]], proc: str) -> typing.List[Row]:
    """List the results of `look` for processes, each with the name of its node, once for each unit, and at most MOST_NODES."""
    found: typing.Dict[typing.Tuple[str, str], Row] = {}
    for pid in sorted(int(name) for name in os.listdir(proc) if name.isdigit()):
        try:
            row = look(pid)
        except OSError:  # it has ended, has no such file, or root in a container may not look at it
            continue
        if row is not None:
            node = _name_of(pid, proc)
            found.setdefault((row["unit"], "" if row["unit"] else node), dict(row, node=node))
        if len(found) == MOST_NODES:
            break
    return list(found.values())


def _read_hosts(path: str) -> typing.Set[str]:
    """Read the names in a file such as /etc/hosts. Raises OSError."""
    lines = read_regular(path, _MOST_HOSTS).decode("utf-8", "replace").lower().splitlines()
    return {name for line in lines for name in line.partition("#")[0].split()[1:]}


def _unit_of(pid: int, proc: str) -> typing.Tuple[str, str]:
    """Return the unit of a process, and the person whose manager has it."""
    groups = text(os.path.join(proc, str(pid), "cgroup"))
    return ports.unit(groups), plain(ports.person(groups), LINE)


def _read_words(pid: int, proc: str) -> typing.List[str]:
    """Read the words by which a process was started (proc(5), /proc/PID/cmdline)."""
    return text(os.path.join(proc, str(pid), "cmdline"), 65536).split("\0")


def _name_of(pid: int, proc: str) -> str:
    """Name a node: by __name, as roslaunch writes it, or by its program, which may be a script."""
    words = _read_words(pid, proc)
    names = [word.partition(":=")[2] for word in words if word.startswith("__name:=")]
    script = next((word for word in words[1:2] if word.startswith("/")), words[0])
    return plain(names[-1] if names else os.path.basename(script), LINE)
