# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The system of this machine: its name, release, Python, systemd and multicast routers."""

import os
import platform
import re
import shlex
import typing

from .._base.commands import run, text


def system(root: str = "/") -> typing.Dict[str, typing.Any]:
    """Read the host name, Python, kernel, operating system (os-release(5)) and systemd."""
    release = {}
    for word in _words(text(os.path.join(root, "etc/os-release"))):
        name, _equals, value = word.partition("=")
        release[name] = value
    version = re.match(r"systemd (\d+)", run(["systemctl", "--version"]).text)
    return {
        "hostname": os.uname().nodename,
        "python": platform.python_version(),
        "kernel": os.uname().release,
        "os": {
            "id": release.get("ID", ""),
            "version": release.get("VERSION_ID", ""),
            "name": release.get("PRETTY_NAME", ""),
        },
        "systemd": {
            # sd_booted(3)
            "running": os.path.isdir(os.path.join(root, "run/systemd/system")),
            "version": int(version.group(1)) if version else 0,
            "net_admin": may_give(text(os.path.join(root, "proc/1/status")), _CAP_NET_ADMIN),
        },
    }


_CAP_NET_ADMIN = 12  # capabilities(7)


def may_give(status: str, capability: int) -> bool:
    """True if a process with this /proc/PID/status may give a capability to others, or if the line is missing."""
    bounds = re.search(r"^CapBnd:\s*([0-9a-fA-F]+)$", status, re.MULTILINE)
    return bounds is None or bool(int(bounds.group(1), 16) >> capability & 1)


def _words(content: str) -> typing.List[str]:
    try:
        return shlex.split(content, comments=True)
    except ValueError:  # an unfinished quotation
        return content.split()


def folders(wanted: typing.Iterable[str]) -> typing.List[str]:
    """Return the paths that are folders."""
    return [path for path in wanted if os.path.isdir(path)]
