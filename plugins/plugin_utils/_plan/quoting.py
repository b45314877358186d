# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Values on their way into a unit of systemd, which reads `%`, `$`, quotes, spaces and line breaks as its own.

Every value that a unit takes passes one of these functions. What no quotes can hold is refused with a sentence.
"""

from __future__ import annotations

import re

_PLAIN = re.compile(r"[A-Za-z0-9_./:@,=+-]+")
_PROGRAM = re.compile(r"/[A-Za-z0-9_./+-]*[A-Za-z0-9_+-]")


class Unquotable(ValueError):
    """A value that fits into no unit; the sentence says which, and what was expected."""


def text(value: str) -> str:
    """Return a value for a setting that is one text, as Description= is, or for a comment (systemd.unit(5), Specifiers)."""
    if not value.isprintable():  # control characters, and bytes that were no UTF-8
        raise Unquotable(f"{value!r} is to stand in a unit of systemd; expected printable characters on one line.")
    return value.replace("%", "%%")


def argument(value: str) -> str:
    """Return a value as one argument of a command line (systemd.service(5), Command lines)."""
    if _PLAIN.fullmatch(value):
        return value
    escaped = text(value).replace("\\", "\\\\").replace('"', '\\"').replace("$", "$$")
    return f'"{escaped}"'


def program(path: str) -> str:
    """Return the path of a program, the first word of a command line: a mark before it would decide who runs it."""
    if not _PROGRAM.fullmatch(path):
        raise Unquotable(
            f"The program {path!r} is to be run by a unit of systemd; expected an absolute path of letters, digits and _ . / + -: "
            "install it at such a place."
        )
    return path
