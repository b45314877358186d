# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The hosts and ports in URIs of nodes, each in its only spelling: a spelling that programs read in different ways is refused.

Nodes, modules and controller read foreign hosts only here. The modules have a copy (plugins/module_utils/_probe/ros_client/hosts.py,
tools/copies.py), so it runs on Python 3.6 and needs nothing.
"""

import ipaddress
import re
import typing
from functools import lru_cache

LONGEST = 300  # characters of a URI: a name has 253 at most
# No path, user or query: programs differ in the host that they read in such a text.
_URI = re.compile(r"[a-z]+://(?:([a-z0-9_.-]+)|\[([0-9a-f:]+)\])(?::([0-9]{1,5}))?/?", re.ASCII | re.IGNORECASE)
_LABEL = "[a-z0-9_](?:[a-z0-9_-]{0,61}[a-z0-9_])?"
# getaddrinfo(3) takes a number at the end for an address: 127.1, 2130706433, 0x7f.1
_HOST_NAME = re.compile(rf"(?:{_LABEL}\.)*(?!(?:[0-9]+|0x[0-9a-f]*)\Z){_LABEL}")


def place_of(uri: str) -> typing.Tuple[str, int]:
    """The host of a URI in its only spelling, and its port, 0 if the URI names no port. The host is empty if the URI names no host, or in another spelling.

    A host is an IPv4 address in its usual spelling, an IPv6 address as RFC 5952 writes it, or a name in small letters. All
    other ways to write an address are refused, since a list of hosts has each one once.
    """
    return _read_place(uri) if len(uri) <= LONGEST else ("", 0)


@lru_cache(4096)  # used with each news of a master
def _read_place(uri: str) -> typing.Tuple[str, int]:
    found = _URI.fullmatch(uri)
    if found is None or int(found.group(3) or 0) >= 1 << 16:
        return "", 0
    name, inner = found.group(1), found.group(2)
    return (_normalize_ipv6(inner) if inner else spell_host(name)), int(found.group(3) or 0)


def spell_host(text: str) -> str:
    """An IPv4 address, or the name of a host in small letters; empty for any other spelling of an address, and for no host."""
    name = text.lower()
    return name if is_address(name) or is_host_name(name) else ""


def is_host_name(text: str) -> bool:
    """True for the name of a host in small letters that no program takes for an address."""
    return len(text) <= LONGEST and bool(_HOST_NAME.fullmatch(text))


def _normalize_ipv6(text: str) -> str:
    """An IPv6 address in its only spelling; empty for any other text, and for an IPv4 address that is written as one."""
    try:
        address = ipaddress.IPv6Address(text)
    except ValueError:
        return ""
    return "" if address.ipv4_mapped else str(address)


def host_of(uri: str) -> str:
    """The host of a URI as `place_of` has it."""
    return place_of(uri)[0]


def port_of(uri: str) -> int:
    """The port of a URI; 0 if the URI names no port."""
    return place_of(uri)[1]


def is_address(host: str) -> bool:
    """True for an IPv4 address in its usual spelling: 010 is 8 for some programs."""
    try:
        return str(ipaddress.IPv4Address(host)) == host
    except ValueError:
        return False
