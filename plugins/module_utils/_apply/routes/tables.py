# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The names of routing tables, as the command ip knows them (ip-route(8), /etc/iproute2/rt_tables)."""

import glob
import os
import typing

from ..._base import commands

_USUAL = {"default": 253, "main": 254, "local": 255}
_FOLDERS = ("usr/share/iproute2", "usr/lib/iproute2", "etc/iproute2")  # a name in a later one counts


def read_tables(root: str = "/") -> typing.Dict[str, int]:
    """The numbers of the routing tables by name."""
    numbers = dict(_USUAL)
    for folder in _FOLDERS:
        base = os.path.join(root, folder)
        for path in [
            os.path.join(base, "rt_tables"),
            *sorted(glob.glob(os.path.join(glob.escape(base), "rt_tables.d", "*.conf"))),
        ]:
            numbers.update(_parse_lines(commands.text(path)))
    return numbers


def _parse_lines(text: str) -> typing.Iterator[typing.Tuple[str, int]]:
    """The lines NUMBER NAME; numbers may be hexadecimal."""
    for line in text.splitlines():
        words = line.partition("#")[0].split()
        try:
            yield words[1], int(words[0], 0)
        except (IndexError, ValueError):
            continue
