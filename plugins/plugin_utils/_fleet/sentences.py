# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""How sentences become a message."""

from __future__ import annotations

from collections.abc import Sequence


def numbered(problems: Sequence[str]) -> str:
    """Problems as a message: the only one as it is, several as a numbered list."""
    if len(problems) == 1:
        return problems[0]
    return "\n".join([f"{len(problems)} problems:", *(f"{number}. {text}" for number, text in enumerate(problems, 1))])
