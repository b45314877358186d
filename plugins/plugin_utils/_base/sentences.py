# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Messages made of sentences, and parts of sentences: the expected value, the value that was probably meant, lists."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence

from .plain_text import LINE, plain


class UnexpectedValue(ValueError):
    """A value is not of its kind. The text is the expected one."""


def nearest(name: str, known: Iterable[str]) -> str:
    """Return ' (did you mean X?)' for a mistyped name, or an empty text."""
    close = difflib.get_close_matches(name, list(known), n=1)
    return f" (did you mean {close[0]}?)" if close else ""


def number_problems(problems: Sequence[str]) -> str:
    """Return problems as a message: a single one on one line, several as a numbered list."""
    texts = [plain(text, LINE) for text in problems]
    if len(texts) == 1:
        return texts[0]
    return "\n".join([f"{len(texts)} problems:", *(f"{number}. {text}" for number, text in enumerate(texts, 1))])


def join_causes(causes: Sequence[str]) -> str:
    """Return the sentence of a finding: the only cause, or all that it may be."""
    return f"one of these: {'; or '.join(causes)}" if len(causes) > 1 else causes[0]


def shorten_list(names: Iterable[str], most: int = 3, others: str = "more") -> str:
    """Return the first names, and the number of the others."""
    texts = list(names)
    return ", ".join(texts[:most]) + (f" and {len(texts) - most} {others}" if len(texts) > most else "")
