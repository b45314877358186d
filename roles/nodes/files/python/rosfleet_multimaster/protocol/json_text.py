# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Values as a text of JSON, read with bounds: it may be of a stranger.

Such a text is read in a fiftieth of the time that the same values take in XML. Its cost is known before it is read: there
are not more values in it than signs that begin one.
"""

import json
import re
from typing import Any, Callable, List, Sequence

from .graph import InvalidDocument

ROWS = 200  # records, or calls, in one text
MOST = 2 << 20  # characters of a text that is sent: larger values travel as XML
_MEMORY = 24 << 20  # bytes
_CHARACTER, _VALUE, _MAPPING = 4, 120, 300  # bytes that they cost at most
_DIGITS = 400  # of a number: Python before 3.11 takes seconds for a long one
UNWRITABLE = re.compile("[\0-\x08\x0b\x0c\x0e-\x1f\ud800-\udfff\ufffe\uffff]")  # XML has no such characters
_SURROGATE = re.compile(r"\\u[dD][89a-fA-F]")


def to_json(value: Any) -> Any:
    """The text; the value itself if the text would be long."""
    text = json.dumps(value, ensure_ascii=False, separators=(",", ":"))
    return text if len(text) <= MOST else value


def from_json(text: str) -> Any:
    """The values. Raises ValueError, with a sentence."""
    values, mappings = sum(map(text.count, "[,:")), text.count("{")
    if len(text) * _CHARACTER + values * _VALUE + mappings * _MAPPING > _MEMORY:
        raise ValueError(f"its values may take more than {_MEMORY >> 20} MiB of memory")
    try:
        value = json.loads(text, parse_int=_limit_digits(int), parse_float=_limit_digits(float), parse_constant=_refuse)
        if _SURROGATE.search(text):  # half a character (a lone surrogate), which XML cannot carry
            json.dumps(value, ensure_ascii=False).encode()
    except RecursionError:
        raise ValueError("its values are too deep in each other") from None
    except UnicodeEncodeError:
        raise ValueError("it has half a character") from None
    return value


def _limit_digits(kind: Callable[[str], Any]) -> Callable[[str], Any]:
    def read(digits: str) -> Any:
        if len(digits) > _DIGITS:
            raise ValueError(f"a number of more than {_DIGITS} digits")
        return kind(digits)

    return read


def _refuse(constant: str) -> Any:
    raise ValueError(f"{constant} is no number")


# Rows: the records of a roscore, or calls to it. As arrays of XML they cost ten times as much on both sides.


def pack_rows(rows: Sequence[Any]) -> List[str]:
    """Rows as they travel in XML-RPC: a few texts of JSON."""
    return [json.dumps(rows[at : at + ROWS], default=str) for at in range(0, len(rows), ROWS)]


def unpack_rows(texts: Any) -> List[Any]:
    """The rows. Raises InvalidDocument."""
    try:
        return [row for text in texts for row in json.loads(text)]
    except (TypeError, ValueError, RecursionError) as problem:
        raise InvalidDocument(f"no rows: {problem}") from None
