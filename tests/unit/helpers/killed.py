# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""A process that is killed at one of its system calls, or before one of its changes."""

import os
import signal

#: The beginning of a program. `until(step)` makes a function of `step` that ends the program, as kill -9 does, once `left` calls
#: of such functions have begun; 0: never. The changes of files are such functions.
UNTIL = """
import json, os, signal, sys
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.transaction import atomic
left = 0
def until(step):
    def counted(*arguments, **options):
        global left
        left -= 1
        if left == 0:
            os.kill(os.getpid(), signal.SIGKILL)
        return step(*arguments, **options)
    return counted
for name in ("write_by_rename", "remove", "remove_for_good", "make_folders", "remove_folder_if_empty"):
    setattr(atomic, name, until(getattr(atomic, name)))
"""


def die_at_call(step, *names):
    """From now on the `step`-th call of these functions of `os` is SIGKILL."""
    calls = iter(range(step))

    def dying(real):
        def call(*args, **kwargs):
            if next(calls, None) is None:
                os.kill(os.getpid(), signal.SIGKILL)
            return real(*args, **kwargs)

        return call

    for name in names:
        setattr(os, name, dying(getattr(os, name)))
