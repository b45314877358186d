# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""When this computer was changed last: the files and services that decide its names, kernel settings, network and filter.

A kernel does not tell since when a setting or a route is what it is. Its last start and these times bound it.
"""

import glob
import os
import re
import time
import typing

from .._machine import systemd
from .._process import commands

# about -> the files that decide it; of those of a folder the one that was changed last is told.
FILES = {
    "names": (("/etc/hosts",), ("/etc/nsswitch.conf",)),
    "settings": (
        ("/etc/sysctl.conf", "/etc/sysctl.d/*.conf", "/usr/local/lib/sysctl.d/*.conf", "/etc/ufw/sysctl.conf"),
    ),
    "network": (
        (
            "/etc/network/interfaces",
            "/etc/network/interfaces.d/*",
            "/etc/netplan/*.yaml",
            "/etc/systemd/network/*",
            "/etc/NetworkManager/system-connections/*",
        ),
        ("/var/lib/dhcp/*.leases", "/var/lib/NetworkManager/*.lease", "/run/systemd/netif/leases/*"),
    ),
    "filter": (
        (
            "/etc/nftables.conf",
            "/etc/nftables.d/*",
            "/etc/iptables/*",
            "/etc/ufw/*.rules",
            "/etc/firewalld/zones/*.xml",
            "/etc/firewalld/direct.xml",
            "/etc/docker/daemon.json",
        ),
    ),
}
# Services that change the packet filter when they start.
FILTERS = ("docker", "nftables", "ufw", "firewalld", "netfilter-persistent", "libvirtd", "fail2ban")
MOST = 200  # files of a group that are looked at
LOG = 3.0  # seconds for the journal

Row = typing.Dict[str, str]


def changes(root: str = "/") -> typing.List[Row]:
    """Tell what was changed when: files by their content, services that filter packets by their start, the computer itself."""
    found = [
        {"about": about, "what": path, "how": "was changed", "when": format_time(when)}
        for about, groups in FILES.items()
        for path, when in filter(None, (latest(group, root) for group in groups))
    ]
    return found + filters() + start_rows(root)


def latest(patterns: typing.Sequence[str], root: str = "/") -> typing.Optional[typing.Tuple[str, float]]:
    """Find the file that was changed last, and when; None where there is none."""
    paths = [path for pattern in patterns for path in sorted(glob.glob(os.path.join(root, pattern.lstrip("/"))))]
    times = []
    for path in paths[:MOST]:
        try:
            times.append((os.stat(path).st_mtime, path))
        except OSError:
            continue
    return (max(times)[1], max(times)[0]) if times else None


def format_time(when: float) -> str:
    """Write a time as the findings say it."""
    return time.strftime("%Y-%m-%d %H:%M:%S UTC", time.gmtime(when))


def filters() -> typing.List[Row]:
    """Tell when the services started that filter packets."""
    units = systemd.show([f"{name}.service" for name in FILTERS], ("Id", "ActiveState", "StateChangeTimestamp")).units
    return [
        {"about": "filter", "what": unit["Id"], "how": "was started", "when": unit["StateChangeTimestamp"]}
        for unit in units
        if unit.get("ActiveState") == "active" and unit.get("StateChangeTimestamp")
    ]


def start_rows(root: str = "/") -> typing.List[Row]:
    """Tell when the first process of this computer was started (proc(5)): with a container the container's."""
    words = commands.text(os.path.join(root, "proc/1/stat")).rpartition(")")[2].split()
    booted = re.search(r"^btime (\d+)", commands.text(os.path.join(root, "proc/stat")), re.MULTILINE)
    if booted is None or len(words) < 20 or not words[19].isdigit():
        return []
    when = int(booted.group(1)) + int(words[19]) / os.sysconf("SC_CLK_TCK")
    return [{"about": "start", "what": "the computer", "how": "was started", "when": format_time(when)}]


def carrier(interface: str) -> str:
    """Return the last line of the journal of this start about the link of an interface; empty where there is none."""
    pattern = rf"\b{re.escape(interface)}\b.*(link|carrier|disconnect|deauth)"
    argv = ["journalctl", "-b", "-q", "--no-pager", "-o", "short-iso", "-n", "1", "--grep", pattern]
    lines = commands.run(argv, limit=LOG).text.splitlines()
    return lines[-1].strip()[:200] if lines else ""
