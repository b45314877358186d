# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The holders of ports: the kernel's tables of sockets, and the processes that have them open (proc(5))."""

import os
import pwd
import re
import socket
import struct
import typing

from .._base.commands import text
from .._base.plain_text import plain

ESTABLISHED, LISTEN = "01", "0A"  # include/net/tcp_states.h
_MANAGER = re.compile(r"user@(\d{1,10})\.service\Z")  # that of a person's units
_UNIT = re.compile(r"(?<![^/])[^/]+\.(?:service|scope|socket)")  # from the beginning of a name: linear in a long one


class Socket(typing.NamedTuple):
    """A row of the kernel's tables."""

    protocol: str  # tcp or udp
    port: int
    address: str
    uid: int
    inode: str
    state: str
    peer: str  # the address of the other end


def holders(
    wanted: typing.Iterable[typing.Dict[str, typing.Any]], proc: str = "/proc"
) -> typing.List[typing.Dict[str, typing.Any]]:
    """Find the listening TCP and bound UDP sockets on the wanted {protocol, port}, with process, user and unit."""
    places = {(entry["protocol"], entry["port"]) for entry in wanted}
    sockets = [
        entry
        for protocol in ("tcp", "udp")
        for entry in read_sockets(protocol, proc)
        if (entry.protocol, entry.port) in places and (protocol == "udp" or entry.state == LISTEN)
    ]
    owners, unreadable = _owners({entry.inode for entry in sockets}, proc)
    processes = []
    for entry in sockets:
        pid = owners.get(entry.inode, 0)
        if pid <= 1:  # systemd may hold it for a service; root may not read its processes
            pid = _single_unit(unreadable.get(entry.uid, []), proc) or pid
        processes.append(_holder(entry, pid, proc))
    return processes


def read_sockets(protocol: str, proc: str = "/proc") -> typing.List[Socket]:
    """Read the sockets of a protocol, tcp or udp: those of IPv4, then those of IPv6."""
    sockets = []
    tables = (text(os.path.join(proc, "net", table), 1 << 24) for table in (protocol, f"{protocol}6"))
    # One row at a time: every user who opens sockets makes the tables longer.
    for fields in (line.split() for table in tables for line in table.splitlines()[1:]):
        if len(fields) >= 10:
            address, _separator, port = fields[1].partition(":")
            peer = address_of(fields[2].partition(":")[0])
            sockets.append(
                Socket(protocol, int(port, 16), address_of(address), int(fields[7]), fields[9], fields[3], peer)
            )
    return sockets


def count_waiting(port: int, proc: str = "/proc") -> typing.Optional[int]:
    """Count the TCP connections to a port of this computer that still wait for its program to take them; None if no program listens.

    A program that hangs leaves them; a connection that a packet filter drops never waits. The kernel reports this of a socket that listens as its
    receive queue (net/ipv4/tcp_ipv4.c, get_tcp4_sock).
    """
    counts = []
    for table in ("tcp", "tcp6"):
        rows = (line.split() for line in text(os.path.join(proc, "net", table), 1 << 24).splitlines()[1:])
        listens = (row for row in rows if len(row) >= 10 and row[3] == LISTEN)
        counts += [int(row[4].partition(":")[2], 16) for row in listens if int(row[1].partition(":")[2], 16) == port]
    return max(counts) if counts else None


def address_of(digits: str) -> str:
    """Read an address of a table of /proc/net."""
    # 32-bit words, each printed in the byte order of the machine
    words = [int(digits[start : start + 8], 16) for start in range(0, len(digits), 8)]
    family = socket.AF_INET if len(words) == 1 else socket.AF_INET6
    return socket.inet_ntop(family, struct.pack(f"={len(words)}I", *words))


def _owners(
    inodes: typing.Set[str], proc: str
) -> typing.Tuple[typing.Dict[str, int], typing.Dict[int, typing.List[int]]]:
    """Find the process that has each socket open; of several the last, because the first may be systemd's own copy.

    Root in a container may not read some processes. They are returned as well, by user.
    """
    owners: typing.Dict[str, int] = {}
    unreadable: typing.Dict[int, typing.List[int]] = {}
    for pid in sorted(int(name) for name in os.listdir(proc) if name.isdigit()):
        try:
            own = list_inodes(pid, proc)
        except PermissionError:
            unreadable.setdefault(_user_of(pid, proc), []).append(pid)
            continue
        except OSError:
            continue  # it ended
        owners.update((inode, pid) for inode in own if inode in inodes)
    return owners, unreadable


def list_inodes(pid: int, proc: str) -> typing.List[str]:
    """The inodes of a process's open sockets. Raises OSError if it has ended, or may not be looked at."""
    folder = os.path.join(proc, str(pid), "fd")
    links = [_link(os.path.join(folder, descriptor)) for descriptor in os.listdir(folder)]
    return [link[len("socket:[") : -1] for link in links if link.startswith("socket:[")]


def _link(path: str) -> str:
    try:
        return os.readlink(path)
    except FileNotFoundError:
        return ""  # closed just now


def _user_of(pid: int, proc: str) -> int:
    fields = re.search(r"^Uid:\s+(\d+)", text(os.path.join(proc, str(pid), "status")), re.MULTILINE)
    return int(fields.group(1)) if fields else -1


def _single_unit(pids: typing.List[int], proc: str) -> int:
    """Return the first of a user's processes if all belong to one unit, as with a service's own user; else 0."""
    units = {unit(text(os.path.join(proc, str(pid), "cgroup"))) for pid in pids}
    return pids[0] if len(units) == 1 else 0


def _holder(entry: Socket, pid: int, proc: str) -> typing.Dict[str, typing.Any]:
    folder = os.path.join(proc, str(pid))
    try:
        user = pwd.getpwuid(entry.uid).pw_name
    except KeyError:
        user = str(entry.uid)
    return {
        "protocol": entry.protocol,
        "port": entry.port,
        "address": entry.address,
        "pid": pid,
        "command": plain(text(os.path.join(folder, "cmdline"), 4096).replace("\0", " ")) if pid else "",
        "user": user,
        "unit": unit(text(os.path.join(folder, "cgroup"))) if pid else "",
        "person": plain(person(text(os.path.join(folder, "cgroup")))) if pid else "",
        "container": is_contained(text(os.path.join(folder, "status"))) if pid else False,
    }


def is_contained(status: str) -> bool:
    """Return True if the text of /proc/PID/status has a second number: that of a namespace below, as a container has one (proc(5))."""
    return bool(re.search(r"^NSpid:\s+\d+\s+\d", status, re.MULTILINE))


def unit(cgroups: str) -> str:
    """Read the systemd unit in the text of /proc/PID/cgroup: in systemd's hierarchy (version 1), or in the single one."""
    return (_list_units(cgroups) or [""])[-1]


def person(cgroups: str) -> str:
    """Read the user whose own manager (systemctl --user) runs the unit, in the same text; empty for a unit of the computer.

    It is the first one: the groups below are of that user, who names them.
    """
    managers = [found for found in map(_MANAGER.match, _list_units(cgroups)[:-1]) if found]
    if not managers:
        return ""
    number = managers[0].group(1)
    try:
        return pwd.getpwuid(int(number)).pw_name
    except (KeyError, OverflowError):
        return number


def _list_units(cgroups: str) -> typing.List[str]:
    for line in cgroups.splitlines():
        _number, controllers, path = (line.split(":", 2) + ["", ""])[:3]
        units = _UNIT.findall(path) if controllers in ("name=systemd", "") else []
        if units:
            return units
    return []
