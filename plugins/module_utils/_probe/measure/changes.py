# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The times at which files and services of this computer were changed or started that may decide its names and its packet filter.

A kernel does not report since when a rule is there. Its table and its chain show its maker (_verify/diagnose/onset.py of the controller).
"""

import glob
import os
import re
import time
import typing

from ..._base import commands
from ..._contract.computer import RecentChange
from ..._machine import systemd

# about -> the files that decide it; the one that was changed last is reported.
FILES = {
    "names": ("/etc/hosts",),
    "order": ("/etc/nsswitch.conf",),
    "ufw": ("/etc/ufw/*.rules", "/etc/ufw/ufw.conf", "/etc/default/ufw"),
    "firewalld": ("/etc/firewalld/zones/*.xml", "/etc/firewalld/policies/*.xml", "/etc/firewalld/direct.xml"),
    "docker": ("/etc/docker/daemon.json",),
}
# Services that make chains of their own in the packet filter when they start.
MAKERS = ("ufw", "firewalld", "docker", "libvirtd", "fail2ban")
NFTABLES, NFTABLES_FILES = "nftables", ("/etc/nftables.conf", "/etc/nftables.d/*")  # whose files name their tables
TABLE = re.compile(
    r"^\s*(?:add\s+|create\s+)?table\s+(?:(ip|ip6|inet)\s+)?([A-Za-z][A-Za-z0-9_.-]*)\s*(?:\{|;|$)", re.M
)
MOST = 200  # files of a group that are looked at
MOST_TABLES = 50
LOG = 3.0  # seconds for the journal

Row = typing.Dict[str, str]


def changes(root: str = "/") -> typing.List[Row]:
    """List the changes with their times: files by their content, services that filter packets by their start."""
    found = [
        _row(about, path, "was changed", format_time(when))
        for about, patterns in FILES.items()
        for when, path in list_files(patterns, root)[-1:]
    ]
    units = [f"{name}.service" for name in (*MAKERS, NFTABLES)]
    states = systemd.states(units, ("ActiveState", "StateChangeTimestamp"))
    active = {
        name: state.get("StateChangeTimestamp", "")
        for name, state in zip((*MAKERS, NFTABLES), states)
        if state.get("ActiveState") == "active"
    }
    found += [
        _row(name, f"{name}.service", "was started", when) for name, when in active.items() if name in MAKERS and when
    ]
    return found + (tables(root) if NFTABLES in active else [])


def _row(about: str, what: str, how: str, when: str) -> Row:
    return RecentChange(about, what, how, when).plain()


def tables(root: str = "/") -> typing.List[Row]:
    """List for each table of nftables the last change of the file that makes it at boot."""
    return [
        _row(f"table {family or 'ip'} {name}", path, "was changed", format_time(when))
        for when, path in list_files(NFTABLES_FILES, root)
        for family, name in dict.fromkeys(TABLE.findall(commands.text(path)))
    ][:MOST_TABLES]


def list_files(patterns: typing.Sequence[str], root: str = "/") -> typing.List[typing.Tuple[float, str]]:
    """List files with the times of their last change, the oldest first."""
    paths = [path for pattern in patterns for path in sorted(glob.glob(os.path.join(root, pattern.lstrip("/"))))]
    times = []
    for path in paths[:MOST]:
        try:
            times.append((os.stat(path).st_mtime, path))
        except OSError:
            continue
    return sorted(times)


def format_time(when: float) -> str:
    """Write a time as the findings say it."""
    return time.strftime("%Y-%m-%d %H:%M:%S UTC", time.gmtime(when))


def carrier(interface: str) -> str:
    """Return the last line of the journal of this start about the link of an interface; empty if the journal has no such line."""
    pattern = rf"\b{re.escape(interface)}\b.*(link|carrier|disconnect|deauth)"
    argv = ["journalctl", "-b", "-q", "--no-pager", "-o", "short-iso", "-n", "1", "--grep", pattern]
    lines = commands.run(argv, limit=LOG).text.splitlines()
    return lines[-1].strip()[:200] if lines else ""
