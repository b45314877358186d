# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""Resources that programs of this computer depend on: a clock that is kept right, and room to write."""

import ctypes
import os
import typing

UNSYNCHRONISED = 5  # TIME_ERROR of adjtimex(2)
TIMEX = 1024  # bytes, more than struct timex has anywhere; all zero, it only asks
# Where programs of ROS and services write, beside the state of the services themselves.
FOLDERS = ("/var/lib", "/var/log", "/tmp", "/run")
STATE = "/var/lib/private/multimaster-{}"


def clock() -> typing.Dict[str, typing.Optional[bool]]:
    """Say if something keeps the clock right, such as chrony, as the kernel knows it; None where it does not tell."""
    try:
        state = ctypes.CDLL(None).adjtimex(ctypes.create_string_buffer(TIMEX))
    except (OSError, AttributeError):  # no such function in this C library
        return {"synchronised": None}
    return {"synchronised": None if state < 0 else state != UNSYNCHRONISED}


def disks(
    services: typing.Sequence[str], folders: typing.Sequence[str] = FOLDERS
) -> typing.List[typing.Dict[str, typing.Any]]:
    """Count what is left for others than root where services write; each file system once, by the first of its folders."""
    found: typing.Dict[int, typing.Dict[str, typing.Any]] = {}
    for path in [STATE.format(service) for service in services] + list(folders):
        try:
            device, there = os.stat(path).st_dev, os.statvfs(path)
        except OSError:
            continue  # it is not there; no program writes there
        found.setdefault(
            device,
            {
                "path": path,
                "free_bytes": there.f_bavail * there.f_frsize,
                "free_files": there.f_favail if there.f_files else None,  # some file systems do not count them
            },
        )
    return list(found.values())
