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


# Programs that pass multicast on between interfaces, by their units in Debian; the kernel takes one at a time.
_MULTICAST_ROUTERS = ("smcroute.service", "mrouted.service", "pimd.service", "igmpproxy.service")


def folders(wanted: typing.Iterable[str]) -> typing.List[str]:
    """Return the paths that are folders."""
    return [path for path in wanted if os.path.isdir(path)]


def multicast_routing() -> typing.Dict[str, typing.Any]:
    """Find smcrouted, and the active units of other programs that pass multicast on."""
    places = (os.path.join(folder, "smcrouted") for folder in ("/usr/sbin", "/usr/local/sbin", "/sbin"))
    states = run(["systemctl", "is-active"] + list(_MULTICAST_ROUTERS)).text.split()
    return {
        "smcrouted": next((path for path in places if os.access(path, os.X_OK)), ""),
        "others": [unit for unit, state in zip(_MULTICAST_ROUTERS, states) if state == "active"],
    }
