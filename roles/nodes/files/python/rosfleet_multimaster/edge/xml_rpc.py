# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""XML-RPC documents from strangers, read with bounds. Both sides of a call use this."""

import gzip
import io
import re
import xmlrpc.client
import zlib
from typing import Any, Optional, Tuple

MAX_REQUEST = 1 << 20  # bytes
MAX_ANSWER = 64 << 20  # bytes, also unpacked


def unpack(body: bytes, most: int) -> bytes:
    """Unpack gzip, but not without a bound. Raises OSError or ValueError."""
    try:
        with gzip.GzipFile(fileobj=io.BytesIO(body)) as packed:
            unpacked = packed.read(most + 1)
    except (EOFError, zlib.error) as problem:
        raise ValueError(str(problem)) from None
    if len(unpacked) > most:
        raise ValueError(f"more than {most} bytes")
    return unpacked


_ENDLESS = re.compile(rb"[0-9]{401}")


def loads(body: bytes) -> Tuple[Tuple[Any, ...], Optional[str]]:
    """The values and the method of an XML-RPC document; document types and entities are not read."""
    if b"<!DOCTYPE" in body or b"<!ENTITY" in body:
        raise ValueError("a document type in an XML-RPC document")
    if b"\0" in body:  # UTF-16, in which they would not be found
        raise ValueError("an XML-RPC document that is not in UTF-8")
    if _ENDLESS.search(body):  # Python before 3.11 takes seconds for such a number, and everything waits
        raise ValueError("a number of more than 400 digits")
    return xmlrpc.client.loads(body, use_builtin_types=True)
