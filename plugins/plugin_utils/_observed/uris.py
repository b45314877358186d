# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""URIs of masters and nodes: comparison, and the host in them."""

from __future__ import annotations

from functools import lru_cache
from urllib.parse import urlsplit

KEPT = 10000  # answers that are kept: a fleet has few URIs, and each is seen from many computers


@lru_cache(KEPT)
def plain(uri: str) -> str:
    """Return a URI in the form in which two of them are compared: small letters, no slash at the end."""
    return uri.rstrip("/").lower()


def same_uri(one: str, other: str) -> bool:
    """Compare two URIs; capital letters and a slash at the end do not count."""
    return plain(one) == plain(other)


@lru_cache(KEPT)
def host_of(uri: str) -> str:
    """Return the host of a URI in small letters; empty where there is none."""
    return (urlsplit(uri).hostname or "").lower()


def on_loopback(uri: str) -> bool:
    """Say if the host of a URI is this computer's own name for itself: localhost, or 127.0.0.0/8."""
    host = host_of(uri)
    return host == "localhost" or host.startswith("127.")
