# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""A process that is killed at one of its system calls."""

import os
import signal


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
