# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The rules of policy routing, from the lines of `ip rule`. Pure: texts in, types out."""

from __future__ import annotations

from collections.abc import Iterable
from ipaddress import IPv4Network

from .model import NO_WAY, Lookup

# Rules for marked packets, kinds of service, users or ports do not match the packets of a prediction.
OTHERS = ("fwmark", "tos", "dsfield", "uidrange", "ipproto", "sport", "dport", "oif", "l3mdev", "tun_id")
QUIET = ("proto", "protocol", "realms")  # they change nothing here
DETACHED = "[detached]"  # behind the name of an interface that does not exist


def lookups(lines: Iterable[str]) -> tuple[Lookup, ...]:
    """Read rules such as "100: from all to 192.168.12.0/24 lookup 77"; other lines are left out."""
    return tuple(rule for rule in map(_lookup, lines) if rule is not None)


def _lookup(line: str) -> Lookup | None:
    priority, colon, text = line.partition(":")
    words = [word for word in text.split() if word != DETACHED]
    if not (colon and priority.strip().isdigit()):
        return None
    if words and words[0] == "not":
        return _read_negation(int(priority), words[1:])
    try:
        return _rule(int(priority), words)
    except (ValueError, IndexError):
        return None


def _read_negation(priority: int, words: list[str]) -> Lookup | None:
    """Read "not from all fwmark 0xca6c lookup 51820", a rule of a VPN for all packets without the mark."""
    if words[:2] == ["from", "all"] and words[2:3] == ["fwmark"] and words[4:5] == ["lookup"] and len(words) > 5:
        return Lookup(priority, words[5])
    return None


def _rule(priority: int, words: list[str]) -> Lookup | None:
    """Read the words of a rule. Raises ValueError and IndexError for other words."""
    fields: dict[str, str] = {}
    rest = iter(words)
    for word in rest:
        if word in NO_WAY:
            fields["kind"] = word
        elif word in OTHERS:
            return None
        else:
            fields[word] = next(rest, "")
    known = {"from", "to", "iif", "lookup", "table", "kind", "suppress_prefixlength", *QUIET}
    if not known.issuperset(fields) or not ({"lookup", "table", "kind"} & fields.keys()):
        return None
    return Lookup(
        priority,
        table=fields.get("lookup") or fields.get("table", ""),
        source=_network(fields.get("from", "all")),
        destination=_network(fields.get("to", "all")),
        incoming=fields.get("iif", ""),
        kind=fields.get("kind", ""),
        longer=int(fields.get("suppress_prefixlength", "-1")),
    )


def _network(text: str) -> IPv4Network | None:
    return None if text == "all" else IPv4Network(text, strict=False)
