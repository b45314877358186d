# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""Whether this process can replace a file: asked before anything changes, so also in check mode."""

import fcntl
import os
import stat
import struct
import typing

# FS_IOC_GETFLAGS (ioctl_iflags(2)): _IOR('f', 1, long)
_GET_FLAGS = 2 << 30 | struct.calcsize("l") << 16 | ord("f") << 8 | 1
_FLAGS = ((0x10, "immutable"), (0x20, "append-only"))  # chattr(1) has their first letters


def obstacle(path: str, in_place: bool = False) -> str:
    """Say why no file can be written, replaced or removed at this path, and what to do; empty where one can be.

    With `in_place`, a writable file in a folder that is not writable is enough.
    """
    if in_place and os.path.isfile(path) and os.access(path, os.W_OK) and not locked(path):
        return ""
    folder = os.path.dirname(path)
    while folder != "/" and not os.path.lexists(folder):
        folder = os.path.dirname(folder)
    for place in (path, folder):
        flag = locked(place)
        if flag:
            return (
                f"{place} is {flag} (lsattr shows it), so not even root changes it; expected one without that: "
                f"run 'chattr -{flag[0]} {place}', or leave the path to whoever locked it."
            )
    if not os.path.isdir(folder) or os.access(folder, os.W_OK | os.X_OK):
        return ""
    if os.statvfs(folder).f_flag & os.ST_RDONLY:
        return f"The file system of {folder} is mounted read-only; expected a writable one: mount it writable."
    if os.geteuid() != 0:
        return f"{folder} is not writable for the user {os.geteuid()}; expected a writable folder: run as root (become: true)."
    return f"{folder} is not writable, even for root; expected a writable folder: look at its mount and its security module."


def obstacles(paths: typing.Iterable[str]) -> typing.List[str]:
    """Say it for several paths, each sentence once."""
    return list(dict.fromkeys(filter(None, (obstacle(path) for path in paths))))


def locked(path: str) -> str:
    """The word for the flag that forbids every change of a file or folder (chattr(1)); empty for none."""
    try:
        kind = os.lstat(path).st_mode
        if not (stat.S_ISREG(kind) or stat.S_ISDIR(kind)):
            return ""
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_NOFOLLOW | os.O_CLOEXEC)
    except OSError:
        return ""
    try:
        flags = struct.unpack("I", fcntl.ioctl(descriptor, _GET_FLAGS, struct.pack("I", 0)))[0]
    except OSError:  # a file system without flags
        return ""
    finally:
        os.close(descriptor)
    return next((word for bit, word in _FLAGS if flags & bit), "")
