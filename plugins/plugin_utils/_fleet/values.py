# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Common parts of the readers of values."""

from __future__ import annotations

import difflib
from typing import Any


class UnexpectedValue(ValueError):
    """A value is not of its kind. The text is the expected one."""


def nearest(name: str, known: Any) -> str:
    """Return ' (did you mean X?)' for a mistyped name, or an empty text."""
    close = difflib.get_close_matches(name, list(known), n=1)
    return f" (did you mean {close[0]}?)" if close else ""
