# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Calls that touch the outside, of which the n-th fails, or ends the process as SIGKILL does."""

import contextlib
import errno
import functools
import os

KILL = "kill"
ERRORS = (errno.ENOSPC, errno.EIO, errno.EROFS, errno.EACCES, errno.EDQUOT)
#: functions of os that change something, open it or list it
CALLS = (
    "open", "write", "pwrite", "rename", "replace", "link", "symlink", "unlink", "remove", "mkdir", "rmdir", "chmod",
    "fchmod", "chown", "fchown", "truncate", "ftruncate", "fsync", "fdatasync", "listdir", "scandir", "listxattr",
    "setxattr",
)  # fmt: skip


class Fault:
    """While it is entered, the call with the number `at` fails with this error, and all after it where it is `lasting`."""

    def __init__(self, at, error, lasting=False):
        self.at, self.error, self.lasting = at, error, lasting
        self.count, self.told = 0, ""  # `told`: the call that failed first

    def strike(self, what, path=None):
        """Raise the error, or end the process, where it is the turn of this call."""
        here, self.count = self.count, self.count + 1
        if here == self.at or (self.lasting and here > self.at):
            self.told = self.told or what
            if self.error == KILL:
                os._exit(9)
            raise OSError(self.error, os.strerror(self.error), *([path] if path is not None else []))

    def _failing(self, name, real):
        @functools.wraps(real)
        def call(*args, **more):
            self.strike(f"{name} {args[:2]}", args[0] if args and isinstance(args[0], (str, bytes)) else None)
            return real(*args, **more)

        return call

    def _fdopen(self, *args, **more):
        stream = self._kept["fdopen"](*args, **more)
        return _Stream(stream, self) if stream.writable() else stream

    def __enter__(self):
        self._kept = {name: getattr(os, name) for name in (*CALLS, "fdopen")}
        for name in CALLS:
            setattr(os, name, self._failing(name, self._kept[name]))
        os.fdopen = self._fdopen
        return self

    def __exit__(self, *_about):
        for name, real in self._kept.items():
            setattr(os, name, real)


class _Stream:
    """A stream whose writing is a call, too."""

    def __init__(self, stream, fault):
        self._stream, self._fault = stream, fault

    def __getattr__(self, name):
        return getattr(self._stream, name)

    def __enter__(self):
        self._stream.__enter__()
        return self

    def __exit__(self, *about):
        return self._stream.__exit__(*about)

    def flush(self):
        self._fault.strike("flush")
        self._stream.flush()


def die(fault, function, *arguments):
    """Call the function in a child that the fault ends; False where it came to its own end before."""
    child = os.fork()
    if child == 0:
        with contextlib.suppress(BaseException), fault:
            function(*arguments)
        os._exit(0)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 9
