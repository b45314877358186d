# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Parts that the readers of values share."""

from __future__ import annotations

import difflib
from typing import Any


class UnexpectedValue(ValueError):
    """A value is not of its kind; the text says what was expected."""


def nearest(name: str, known: Any) -> str:
    """Return ' (did you mean X?)' for a mistyped name, or an empty text."""
    close = difflib.get_close_matches(name, list(known), n=1)
    return f" (did you mean {close[0]}?)" if close else ""
