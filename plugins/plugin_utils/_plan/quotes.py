# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Values on their way into a unit of systemd. In it `%`, `$`, quotes, spaces and line breaks have a meaning.

Every value of a unit passes one of these functions. A value that no quotes can hold is refused with a sentence.
"""

from __future__ import annotations

import re

_PLAIN = re.compile(r"[A-Za-z0-9_./:@,=+-]+")
_PROGRAM = re.compile(r"/[A-Za-z0-9_./+-]*[A-Za-z0-9_+-]")


class Unquotable(ValueError):
    """A value that fits into no unit. The sentence has the value, and the expected one."""


def escape_text(value: str) -> str:
    """Return a value for a setting with one text, such as Description=, or for a comment (systemd.unit(5), Specifiers)."""
    if not value.isprintable():  # control characters, and bytes that were no UTF-8
        raise Unquotable(f"{value!r} is to be in a unit of systemd; expected printable characters on one line.")
    return value.replace("%", "%%")


def quote_argument(value: str) -> str:
    """Return a value as one argument of a command line (systemd.service(5), Command lines)."""
    if _PLAIN.fullmatch(value):
        return value
    escaped = escape_text(value).replace("\\", "\\\\").replace('"', '\\"').replace("$", "$$")
    return f'"{escaped}"'


def check_program(path: str) -> str:
    """Return the path of a program, the first word of a command line. A mark before it would change the user who runs it."""
    if not _PROGRAM.fullmatch(path):
        raise Unquotable(
            f"The program {path!r} is to be run by a unit of systemd; expected an absolute path of letters, digits and _ . / + -: "
            "install it at such a place."
        )
    return path
