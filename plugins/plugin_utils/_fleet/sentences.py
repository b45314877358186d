# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Messages made of sentences, and lists in them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from .plain_text import LINE, plain


def number_problems(problems: Sequence[str]) -> str:
    """Return problems as a message: a single one on one line, several as a numbered list."""
    texts = [plain(text, LINE) for text in problems]
    if len(texts) == 1:
        return texts[0]
    return "\n".join([f"{len(texts)} problems:", *(f"{number}. {text}" for number, text in enumerate(texts, 1))])


def shorten_list(names: Iterable[str], most: int = 3, others: str = "more") -> str:
    """Return the first names, and the number of the others."""
    texts = list(names)
    return ", ".join(texts[:most]) + (f" and {len(texts) - most} {others}" if len(texts) > most else "")
