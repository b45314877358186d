# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""URIs of masters and nodes: comparison."""

from __future__ import annotations

from collections.abc import Iterable
from functools import lru_cache

CACHE_SIZE = 10000  # a fleet has few URIs, and each is seen from many computers


@lru_cache(CACHE_SIZE)
def normalise_uri(uri: str) -> str:
    """Return a URI in the form for comparison: small letters, no slash at the end."""
    return uri.rstrip("/").lower()


def is_same_uri(one: str, other: str) -> bool:
    """Return True if two URIs are the same; capital letters and a slash at the end do not count."""
    return normalise_uri(one) == normalise_uri(other)


def is_one_of(uri: str, others: Iterable[str]) -> bool:
    """Return True if a URI is among others."""
    return any(is_same_uri(uri, other) for other in others)
