# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""A file for other programs, which read it at any time: it is replaced as a whole."""

import contextlib
import os
import stat


def read(path: str, most: int) -> str:
    """The text of a regular file that another user may have made. Raises OSError, and ValueError for anything else."""
    opened = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
    with open(opened, "rb") as file:
        if not stat.S_ISREG(os.fstat(opened).st_mode):
            raise ValueError(f"{path} is no file")
        data = file.read(most + 1)
    if len(data) > most:
        raise ValueError(f"{path} has more than {most} bytes")
    return data.decode("utf-8")


def write(path: str, text: str) -> None:
    """Write the file anew, readable for every user. Raises OSError."""
    draft = f"{path}.new"
    try:
        with open(draft, "w", encoding="utf-8") as file:
            os.fchmod(file.fileno(), 0o644)  # whatever the umask of the service is
            file.write(text)
        os.rename(draft, path)
    except BaseException:  # also SystemExit: a signal may end the program here
        with contextlib.suppress(OSError):
            os.unlink(draft)
        raise


def remove(path: str) -> None:
    """Remove the file, if it is there, and the draft that a killed writer left."""
    for name in (path, f"{path}.new"):
        with contextlib.suppress(OSError):
            os.unlink(name)
