# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""A message made of sentences."""

from __future__ import annotations

from collections.abc import Sequence


def numbered(problems: Sequence[str]) -> str:
    """Return problems as a message: a single one as it is, several as a numbered list."""
    if len(problems) == 1:
        return problems[0]
    return "\n".join([f"{len(problems)} problems:", *(f"{number}. {text}" for number, text in enumerate(problems, 1))])
