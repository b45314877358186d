# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The reader of a process's environment."""

import os
import typing


def environment(pid: typing.Union[int, str], proc: str = "/proc") -> typing.Dict[str, str]:
    """Read the variables with which a process was started (proc(5), /proc/PID/environ).

    Raises OSError where the process has ended, or where this user may not look at it: root in a container may not.
    """
    with open(os.path.join(proc, str(pid), "environ"), "rb") as stream:
        return parse(stream.read())


def parse(content: bytes) -> typing.Dict[str, str]:
    """Split the content of /proc/PID/environ; bytes that are no UTF-8 become surrogates, as in os.environ."""
    pairs = [entry.partition("=") for entry in content.decode("utf-8", "surrogateescape").split("\0")]
    return {name: value for name, equals, value in pairs if equals}
