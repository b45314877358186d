# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Measurements of a computer as one short text, until they are judged.

Ansible keeps two copies of each result, value by value, and each of its workers begins with them. In a large fleet that was most
of its memory. A text is kept once, and repeated words cost it nothing. Only the action that has checked an answer packs it.
"""

from __future__ import annotations

import base64
import json
import zlib
from collections.abc import Mapping
from functools import lru_cache
from typing import Any

PACKED = "packed"
QUICK = 1  # of the levels of zlib; the others pack little more
OF_ANSIBLE = ("deprecations", "diff", "invocation", "warnings")  # Ansible itself reads these


def pack(result: Mapping[str, Any]) -> dict[str, Any]:
    """Return a result with its lists and dictionaries in one text."""
    large = {key: value for key, value in result.items() if isinstance(value, (dict, list)) and key not in OF_ANSIBLE}
    if not large:
        return dict(result)
    text = base64.b64encode(zlib.compress(json.dumps(large).encode(), QUICK)).decode()
    return {**{key: value for key, value in result.items() if key not in large}, PACKED: text}


def unpack(result: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return a result with its lists and dictionaries, also one that is not packed."""
    return {**result, **_read(str(result[PACKED]))} if PACKED in result else result


@lru_cache(1)  # the parts of one result are read one after the other
def _read(text: str) -> dict[str, Any]:
    large: dict[str, Any] = json.loads(zlib.decompress(base64.b64decode(text)))
    return large
