# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Shared by the tests of what changes a machine: runs that are killed."""

import os
import signal

import pytest

#: the calls that change files, or open one
CALLS = ("open", "write", "rename", "unlink", "mkdir", "rmdir", "symlink", "chmod", "fchmod", "fsync")


@pytest.fixture
def killed_at():
    """Call a function in a child that gets SIGKILL instead of its `step`-th call that may change a file.

    Returns False when the function ended before.
    """

    def run(step, function, *arguments):
        child = os.fork()
        if child == 0:
            calls = iter(range(step))

            def dying(real):
                def call(*args, **kwargs):
                    if next(calls, None) is None:
                        os.kill(os.getpid(), signal.SIGKILL)
                    return real(*args, **kwargs)

                return call

            for name in CALLS:
                setattr(os, name, dying(getattr(os, name)))
            try:
                function(*arguments)
            finally:
                os._exit(0)
        return os.WIFSIGNALED(os.waitpid(child, 0)[1])

    return run
