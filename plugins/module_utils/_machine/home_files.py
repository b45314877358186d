# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""A program that reads files of a home folder. A process of that person runs only this source."""

import glob
import json
import os
import stat
import sys


def find_lines(patterns, names):
    """Return (path, lines) of the files that name one of `names`. Other lines are empty, so line numbers stay right."""
    files = []
    for pattern in patterns:
        for path in sorted(glob.glob(pattern))[:100]:
            try:
                descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_NOCTTY)
                with open(descriptor, "rb") as stream:
                    if stat.S_ISREG(os.fstat(descriptor).st_mode):
                        lines = _blank_others(stream.read(1 << 20).decode("utf-8", "replace").split("\n"), names)
                        if lines:
                            files.append([path, lines[:5000]])
            except OSError:
                pass
    return files


def _blank_others(lines, names):
    lines = [line.rstrip("\r") if len(line) < 500 and any(name in line for name in names) else "" for line in lines]
    while lines and not lines[-1]:
        lines.pop()
    return lines


if __name__ == "__main__":
    sys.stdout.write(json.dumps(find_lines(*json.load(sys.stdin))) + "\n")
