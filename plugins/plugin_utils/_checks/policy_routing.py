# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The rule or closed route that takes packets for an address: pure, lines of `ip` in, words for `ip ... del` out.

People paste the words. So a line is used only if it has nothing but words of `ip`, addresses and numbers.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from ipaddress import IPv4Address, IPv4Network

from .._observed.observations import Policy

RULE = re.compile(
    r"(?P<priority>\d+): from (?P<source>all|[0-9./]+)(?: to (?P<to>[0-9./]+))?(?: iif \S+)?(?: lookup (?P<table>[\w.-]+)| (?P<kind>\w+))(?: proto \w+)?",
    re.ASCII,
)
CLOSED = re.compile(
    r"(?P<kind>blackhole|unreachable|prohibit) (?P<to>default|[0-9./]+)(?: table (?P<table>[\w.-]+))?(?: [\w .:/-]*)?",
    re.ASCII,
)
KINDS = ("blackhole", "unreachable", "prohibit")


def taker(policy: Policy, address: str) -> tuple[str, str]:
    """Find the rule or route that takes packets for an address: ("rule" or "closed", words to delete it), or empty texts."""
    for rule in filter(None, map(RULE.fullmatch, _lines(policy.rules))):
        if (rule["table"] or rule["kind"] in KINDS) and _holds(rule["to"] or "", address):
            return "rule", _words(rule)
    for route in filter(None, map(CLOSED.fullmatch, _lines(policy.closed))):
        if _holds(route["to"], address):
            return "closed", " ".join(filter(None, [route["kind"], route["to"], _table(route["table"])]))
    return "", ""


def _lines(lines: Iterable[str]) -> list[str]:
    return [" ".join(line.split()) for line in lines]


def _words(rule: re.Match[str]) -> str:
    place = _table(rule["table"]) if rule["table"] else rule["kind"]
    return f"priority {rule['priority']} from {rule['source']} to {rule['to']} {place}"


def _table(name: str | None) -> str:
    return f"table {name}" if name else ""


def _holds(network: str, address: str) -> bool:
    """Say if an address is in a network. A rule for all addresses never counts."""
    try:
        return IPv4Address(address) in IPv4Network(network, strict=False)
    except ValueError:
        return False
