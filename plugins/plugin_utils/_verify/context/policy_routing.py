# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The rule or closed route that takes packets for an address: pure, lines of `ip` in, words for `ip ... del` out.

People paste the words. So a line is used only if it has nothing but words of `ip`, addresses and numbers.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from ipaddress import IPv4Address, IPv4Network

from ..._base import advice
from ..._network.model import ANY_PORT
from ..._network.policy import lookups, write_rule
from ..observe.observations import PolicyRouting

CLOSED = re.compile(
    r"(?P<kind>blackhole|unreachable|prohibit) (?P<to>default|[0-9./]+)(?: table (?P<table>[\w.-]+))?(?: [\w .:/-]*)?",
    re.ASCII,
)


def taker(policy: PolicyRouting, address: str) -> tuple[str, str]:
    """Find the rule or route that takes packets for an address: ("rule" or "closed", words to delete it), or empty texts."""
    for rule in lookups(policy.rules):
        words, takes_all = write_rule(rule), not rule.protocol and rule.ports == rule.source_ports == ANY_PORT
        if takes_all and _holds(str(rule.destination or ""), address) and advice.format_value("rule", words):
            return "rule", words
    for route in filter(None, map(CLOSED.fullmatch, _lines(policy.closed))):
        if _holds(route["to"], address):
            return "closed", " ".join(filter(None, [route["kind"], route["to"], _table(route["table"])]))
    return "", ""


def _lines(lines: Iterable[str]) -> list[str]:
    return [" ".join(line.split()) for line in lines]


def _table(name: str | None) -> str:
    return f"table {name}" if name else ""


def _holds(network: str, address: str) -> bool:
    """Return True if an address is in a network. A rule for all addresses never counts."""
    try:
        return IPv4Address(address) in IPv4Network(network, strict=False)
    except ValueError:
        return False
