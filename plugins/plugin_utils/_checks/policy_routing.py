# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The rule, or the route to nowhere, that takes what is for an address: pure, lines of `ip` in, words for `ip ... del` out.

The words are pasted by people, so a line with anything else than words of `ip`, addresses and numbers is left alone.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from ipaddress import IPv4Address, IPv4Network

from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._observed.observations import Policy

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
    """Name what takes packets for an address: ("rule" or "closed", the words to delete it); empty texts for nothing."""
    rules = [match for match in map(RULE.fullmatch, _lines(policy.rules)) if match]
    for rule in rules:
        if (rule["table"] or rule["kind"] in KINDS) and _holds(rule["to"] or "", address):
            return "rule", _words(rule)
    found = [match for match in map(CLOSED.fullmatch, _lines(policy.closed)) if match and _holds(match["to"], address)]
    if not found:
        return "", ""
    return "closed", " ".join(filter(None, [found[0]["kind"], found[0]["to"], _table(found[0]["table"])]))


def _lines(lines: Iterable[str]) -> list[str]:
    return [" ".join(line.split()) for line in lines]


def _words(rule: re.Match[str]) -> str:
    place = _table(rule["table"]) if rule["table"] else rule["kind"]
    return f"priority {rule['priority']} from {rule['source']} to {rule['to']} {place}"


def _table(name: str | None) -> str:
    return f"table {name}" if name else ""


def _holds(network: str, address: str) -> bool:
    """Say if an address is in a network; a rule for all addresses has its reason, and is shown by nothing here."""
    try:
        return IPv4Address(address) in IPv4Network(network, strict=False)
    except ValueError:
        return False
