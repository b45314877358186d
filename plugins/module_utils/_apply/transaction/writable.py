# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The right of this process to replace a file: asked before anything changes, so also in check mode."""

import errno
import fcntl
import os
import re
import stat
import struct
import typing

from ..._base.commands import text
from . import atomic

# FS_IOC_GETFLAGS (ioctl_iflags(2)): _IOR('f', 1, long)
_GET_FLAGS = 2 << 30 | struct.calcsize("l") << 16 | ord("f") << 8 | 1
_FLAGS = ((0x10, "immutable"), (0x20, "append-only"))  # chattr(1) has their first letters


def obstacle(path: str, in_place: bool = False) -> str:
    """Say why no file can be written, replaced or removed at this path, and the remedy; empty if one can be.

    With `in_place`, a writable file in a folder that is not writable is enough.
    """
    if in_place and os.path.isfile(path) and os.access(path, os.W_OK) and not lock_flag(path):
        return ""
    folder = os.path.dirname(path)
    while folder != "/" and not os.path.lexists(folder):
        folder = os.path.dirname(folder)
    for place in (path, folder):
        flag = lock_flag(place)
        if flag:
            return (
                f"{place} is {flag} (lsattr shows it), so not even root changes it; expected one without that: "
                f"run 'chattr -{flag[0]} {place}', or ask the person who locked it."
            )
    return _path_obstacle(path, folder) or _folder_obstacle(folder)


def _path_obstacle(path: str, folder: str) -> str:
    """Say why this path is no place for a file that is replaced; empty if it is one."""
    longest = _longest_name(folder)
    if len(os.fsencode(os.path.basename(path))) > longest:
        return (
            f"The name of {path} is longer than the {longest} bytes that a file there can have while it is replaced; expected a shorter "
            "one: correct the path."
        )
    if _is_virtual(folder):
        return f"{folder} is no place for files, but a view into the kernel; expected a folder on a disk: correct the path {path}."
    if _is_mount_point(path):
        return f"Something is mounted at {path}, so it cannot be replaced; expected a file of its folder: unmount it, or correct the path."
    return ""


def _folder_obstacle(folder: str) -> str:
    """Say why nothing can be written in a folder; empty if it can, or if it is no folder."""
    if not os.path.isdir(folder) or os.access(folder, os.W_OK | os.X_OK):
        return ""
    if os.statvfs(folder).f_flag & os.ST_RDONLY:
        return f"The file system of {folder} is mounted read-only; expected a writable one: mount it writable."
    if os.geteuid() != 0:
        return f"{folder} is not writable for the user {os.geteuid()}; expected a writable folder: run as root (become: true)."
    return f"{folder} is not writable, even for root; expected a writable folder: look at its mount and its security module."


def _longest_name(folder: str) -> int:
    """The longest name of a file, in bytes: its neighbour, which replaces it, has a longer one (atomic.py)."""
    try:
        return os.pathconf(folder, "PC_NAME_MAX") - len(atomic.NEIGHBOUR) - len("-4194304")
    except (OSError, ValueError):  # the folder is missing, or is a file
        return 255


def _is_virtual(folder: str) -> bool:
    """True for /proc, /sys and the like: no room for anything, and no file without a name can be made (open(2), O_TMPFILE)."""
    try:
        if os.statvfs(folder).f_blocks:
            return False
        os.close(os.open(folder, os.O_TMPFILE | os.O_WRONLY | os.O_CLOEXEC, 0o600))
    except OSError as problem:
        denied = (errno.EACCES, errno.EPERM) if os.geteuid() == 0 else ()
        return problem.errno in (errno.EOPNOTSUPP, errno.EISDIR, errno.ENOENT, *denied)
    return False


def _is_mount_point(path: str) -> bool:
    """True for a file that is a mount point of its own, as in a container."""
    if not os.path.isfile(path):
        return False
    octal = re.compile(r"\\([0-7]{3})")
    places = [line.split()[4] for line in text("/proc/self/mountinfo").splitlines() if len(line.split()) > 4]
    return os.path.realpath(path) in [octal.sub(lambda match: chr(int(match.group(1), 8)), place) for place in places]


def obstacles(paths: typing.Iterable[str]) -> typing.List[str]:
    """The obstacles of several paths, each sentence once."""
    return list(dict.fromkeys(filter(None, (obstacle(path) for path in paths))))


def lock_flag(path: str) -> str:
    """The word for the flag that forbids every change of a file or folder (chattr(1)); empty without such a flag."""
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
