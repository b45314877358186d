# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The exception Problem, whose text is a sentence for the user, and the remedies of an OSError."""

import contextlib
import errno
import os
import typing

from .plain_text import quote


class Problem(Exception):
    """One sentence for the user: the finding, the expectation, the remedy."""


_REMEDIES = {
    errno.EROFS: "mount its file system writable",
    errno.ENOSPC: "make room on its file system",
    errno.EDQUOT: "make room on its file system",
    errno.EISDIR: "correct the path, or move the folder away",
    errno.EINVAL: "correct the path, or move that away",
    errno.ENOENT: "correct the path, or make its folder",
    errno.ENOTDIR: "correct the path, or move away the file in the place of its folder",
    errno.EFBIG: "correct the path, or look at the program that fills the file",
    errno.EBUSY: "look at the file system that is mounted there",
}


def remedy(problem: OSError) -> str:
    """Return the remedy of an error of a file."""
    if problem.errno in (errno.EACCES, errno.EPERM):
        if os.geteuid() != 0:
            return "run as root (become: true)"
        return "look for the reason that forbids it to root: an immutable file (lsattr; chattr -i), a security module or a network disk"
    return _REMEDIES.get(problem.errno or 0, "look at the file, its file system and its disk")


def explain_error(problem: BaseException) -> str:
    """Return why something failed: the words of the kernel, without a number, or else those of the error."""
    return getattr(problem, "strerror", None) or str(problem)


def unreadable(problem: OSError) -> str:
    """Return the sentence for a user about a file that cannot be read."""
    return _write_sentence(problem, "read", "regular")


@contextlib.contextmanager
def explain_unreadable(end: str = "Nothing was changed.") -> typing.Iterator[None]:
    """Raise Problem for an OSError in this block: the sentence about the file, and the state of things."""
    try:
        yield
    except OSError as problem:
        raise Problem(f"{unreadable(problem)} {end}".rstrip()) from problem


def sentence(problem: Exception) -> str:
    """Return the sentence for a user about a half-done change: the words of a Problem, or the file of an OSError."""
    if isinstance(problem, OSError):
        return _write_sentence(problem, "written", "writable")
    return str(problem)


def _write_sentence(problem: OSError, action: str, kind: str) -> str:
    name, why = quote(problem.filename or "") or "A file", problem.strerror or quote(problem)
    return f"{name} cannot be {action} ({why}); expected a {kind} file: {remedy(problem)}."
