# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""Files and folders replaced in one step.

A file is replaced by writing a neighbour and renaming it (rename(2)). So every reader finds the old content or the new
one, also after a writer that was killed.
"""

import contextlib
import errno
import glob
import os
import stat
import typing

from ..._base.plain_text import quote
from ..._base.regular_files import read_regular

NEIGHBOUR = ".rosfleet-new"  # and the number of the process
_ACL = "system.posix_acl_access"
# Attributes that the kernel computes from the content: the value of the old file would condemn the new one.
_COMPUTED = ("security.ima", "security.evm")

Attributes = typing.Dict[str, bytes]  # extended attributes (xattr(7)): ACLs, labels of SELinux, and those of users


def read_bytes(path: str) -> typing.Optional[bytes]:
    """Read the content of a file; None if there is no file. Raises OSError, also for a path that is no regular file."""
    try:
        return read_regular(path)
    except (FileNotFoundError, NotADirectoryError):
        return None


def attributes(path: str) -> Attributes:
    """Read the extended attributes of a regular file that its successor is to keep; an empty mapping for anything else."""
    try:
        if not stat.S_ISREG(os.lstat(path).st_mode):
            return {}
        names = [name for name in os.listxattr(path, follow_symlinks=False) if name not in _COMPUTED]
        return {name: os.getxattr(path, name, follow_symlinks=False) for name in names}
    except OSError as problem:
        if problem.errno in (errno.ENOENT, errno.ENOTDIR, errno.ENOTSUP, errno.ENODATA):
            return {}
        raise


def _keep(descriptor: int, neighbour: str, path: str, kept: Attributes) -> None:
    """Give a new file, the open neighbour of `path`, these extended attributes. Raises OSError if one cannot be kept."""
    present = attributes(neighbour)
    if _ACL in present and _ACL not in kept:  # from the default ACL of the folder
        os.removexattr(descriptor, _ACL)
    for name, value in sorted(kept.items()):
        if present.get(name) != value:
            try:
                os.setxattr(descriptor, name, value)
            except OSError as problem:
                why = f"Its extended attribute {quote(name)} cannot be kept: {os.strerror(problem.errno or 0)}"
                raise OSError(problem.errno, why, path) from problem


def write_by_rename(
    path: str,
    content: bytes,
    mode: int = 0o644,
    owner: typing.Optional[typing.Tuple[int, int]] = None,
    kept: typing.Optional[Attributes] = None,
) -> None:
    """Replace a file in one step, with these permission bits and, if given, this (uid, gid).

    It gets the extended attributes `kept`, by default those of the file that is there. Raises OSError with the file
    unchanged; EBUSY means that the path is a mount point.
    """
    remove_leftovers(path)
    kept = attributes(path) if kept is None else kept
    neighbour = f"{path}{NEIGHBOUR}-{os.getpid()}"
    descriptor = os.open(neighbour, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    try:
        with os.fdopen(descriptor, "wb") as stream:
            if owner is not None:
                os.fchown(stream.fileno(), owner[0], owner[1])
            _keep(stream.fileno(), neighbour, path, kept)
            os.fchmod(stream.fileno(), mode)  # after an ACL: the bits of the group are its mask
            stream.write(content)
            stream.flush()
            os.fsync(stream.fileno())
        os.rename(neighbour, path)
    except BaseException as problem:
        remove(neighbour)
        if isinstance(problem, OSError):
            problem.filename, problem.filename2 = path, None  # a full disk is said without a file
        raise
    sync_folder(os.path.dirname(path))


def permissions(path: str) -> typing.Tuple[int, typing.Optional[typing.Tuple[int, int]]]:
    """Return the permission bits and the (uid, gid) of a file. For a file that is not there they are 0644 and None."""
    try:
        status = os.stat(path)
    except (FileNotFoundError, NotADirectoryError):
        return 0o644, None
    return stat.S_IMODE(status.st_mode), (status.st_uid, status.st_gid)


def remove_leftovers(path: str) -> None:
    """Remove the neighbours that a killed writer of this path left behind."""
    for leftover in leftovers(path):
        remove(leftover)


def leftovers(path: str) -> typing.List[str]:
    """The neighbours that a killed writer of this path left behind."""
    return glob.glob(glob.escape(path + NEIGHBOUR) + "-*")


def remove(path: str) -> None:
    """Remove a file; one that is gone already is no error."""
    with contextlib.suppress(FileNotFoundError):
        os.unlink(path)


def remove_for_good(path: str) -> None:
    """Remove a file, which a loss of power does not bring back; one that is gone already is no error. Raises OSError."""
    with contextlib.suppress(NotADirectoryError):  # something else is in the place of its folder
        remove(path)
    sync_removal(path)


def sync_removal(path: str) -> None:
    """Make the removal of a file survive a loss of power, also if a run that was killed has removed it. Raises OSError."""
    with contextlib.suppress(FileNotFoundError, NotADirectoryError):  # its folder is gone, too
        sync_folder(os.path.dirname(path))


def find_missing_folders(path: str) -> typing.List[str]:
    """The folders on the way to a folder, and itself, that are not there, outermost first."""
    missing = []
    while path and not os.path.isdir(path):
        missing.append(path)
        path = os.path.dirname(path)
    return missing[::-1]


def make_folders(path: str) -> typing.List[str]:
    """Make a folder (mode 0755) and its missing parents; returns the folders that it made, outermost first.

    Raises OSError, and leaves no folder of them.
    """
    made: typing.List[str] = []
    try:
        for folder in find_missing_folders(path):
            os.mkdir(folder, 0o755)
            made.append(folder)
            os.chmod(folder, 0o755)
    except BaseException:
        with contextlib.suppress(OSError):
            for folder in reversed(made):
                remove_folder_if_empty(folder)
        raise
    return made


def remove_folder_if_empty(path: str) -> None:
    """Remove a folder that is there and empty. One that is not is looked at only, as a read-only file system has it."""
    try:
        if not os.listdir(path):
            os.rmdir(path)
    except OSError as problem:
        if problem.errno not in (errno.ENOENT, errno.ENOTEMPTY, errno.EEXIST, errno.EBUSY):
            raise


def sync_folder(path: str) -> None:
    """Make the renames and removals in a folder survive a loss of power (fsync(2) of the folder)."""
    descriptor = os.open(path or ".", os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    except OSError as problem:
        problem.filename = path
        raise
    finally:
        os.close(descriptor)
