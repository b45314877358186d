# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The reader of regular files. It never waits: a FIFO, a device or a huge file in their place gives an error."""

import errno
import os
import stat
import typing

_MOST = 64 << 20  # bytes; the largest file that any module reads whole
_NOT_REGULAR = (
    (stat.S_ISDIR, errno.EISDIR, "Is a directory"),
    (stat.S_ISFIFO, errno.EINVAL, "Is a pipe (FIFO)"),
    (stat.S_ISSOCK, errno.EINVAL, "Is a socket"),
    (lambda mode: not stat.S_ISREG(mode), errno.EINVAL, "Is a device"),
)


def read_regular(path: str, most: typing.Optional[int] = None) -> bytes:
    """Read a regular file: its first `most` bytes, or all of it. Raises OSError, with EFBIG for a huge file."""
    # Opening a FIFO waits for its writer; O_NONBLOCK means nothing to a regular file.
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_NOCTTY | os.O_CLOEXEC)
    except OSError as problem:
        if problem.errno == errno.ENXIO:  # the error of open(2) for a socket
            raise OSError(errno.EINVAL, "Is a socket", path) from problem
        raise
    try:
        _refuse(os.fstat(descriptor), path, whole=most is None)
        with os.fdopen(descriptor, "rb", closefd=False) as stream:
            return stream.read() if most is None else stream.read(most)
    finally:
        os.close(descriptor)


def _refuse(status: os.stat_result, path: str, whole: bool) -> None:
    """Raise OSError for a path that is no regular file, and for a file that is too large to be read whole."""
    for kind, number, sentence in _NOT_REGULAR:
        if kind(status.st_mode):
            raise OSError(number, sentence, path)
    if whole and status.st_size > _MOST:
        raise OSError(errno.EFBIG, f"Is larger than {_MOST >> 20} MiB", path)
