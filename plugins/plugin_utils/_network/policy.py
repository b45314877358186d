# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The rules of policy routing, from the lines of `ip rule`. Pure: texts in, types out."""

from __future__ import annotations

from collections.abc import Iterable
from ipaddress import IPv4Network

from .model import ANY_PORT, NO_WAY, Lookup

PROTOCOLS = {"1": "icmp", "6": "tcp", "17": "udp"}  # ip prints the name if /etc/protocols has it
QUIET = {"proto", "protocol", "realms"}  # they change nothing here
DETACHED = "[detached]"  # behind the name of an interface that does not exist


def lookups(lines: Iterable[str]) -> tuple[Lookup, ...]:
    """Read rules such as "100: from all to 192.168.12.0/24 lookup 77"; other lines are left out."""
    return tuple(rule for rule in map(_lookup, lines) if rule is not None)


def _lookup(line: str) -> Lookup | None:
    priority, colon, text = line.partition(":")
    words = [word for word in text.split() if word != DETACHED]
    if not (colon and priority.strip().isdecimal()):
        return None
    try:
        match words:
            case ["not", "from", "all", "fwmark", _mark, "lookup", table, *_rest]:  # of a VPN, for all without the mark
                return Lookup(int(priority), table)
            case _:
                return _rule(int(priority), words)
    except ValueError:
        return None


def _rule(priority: int, words: list[str]) -> Lookup | None:
    """Read the words of a rule; None for other words. Raises ValueError for other values.

    Rules for marked packets, kinds of service or users (fwmark, tos, uidrange) do not match the packets of a prediction.
    """
    fields, kind = {}, ""
    rest = iter(words)
    for word in rest:
        if word in NO_WAY:
            kind = word
        else:
            fields[word] = next(rest, "")
    protocol = fields.pop("ipproto", "")
    rule = Lookup(
        priority,
        table=fields.pop("lookup", "") or fields.pop("table", ""),
        source=_network(fields.pop("from", "all")),
        destination=_network(fields.pop("to", "all")),
        incoming=fields.pop("iif", ""),
        kind=kind,
        longer=int(fields.pop("suppress_prefixlength", "-1")),
        protocol=PROTOCOLS.get(protocol, protocol),
        ports=_read_ports(fields.pop("dport", "")),
        source_ports=_read_ports(fields.pop("sport", "")),
    )
    # The remaining words were not understood.
    return rule if fields.keys() <= QUIET and (rule.table or kind) else None


def _read_ports(text: str) -> tuple[int, int]:
    """Read "11311" or "11311-11321". Raises ValueError."""
    first, _dash, last = text.partition("-")
    return (int(first), int(last or first)) if text else ANY_PORT


def write_rule(rule: Lookup) -> str:
    """Return the words of a rule as `ip rule del` takes them."""
    words = [f"priority {rule.priority} from {_write_network(rule.source)}"]
    words += [f"to {_write_network(rule.destination)}"] if rule.destination else []
    words += [f"ipproto {rule.protocol}"] if rule.protocol else []
    for name, (first, last) in (("sport", rule.source_ports), ("dport", rule.ports)):
        words += [f"{name} {first}" if first == last else f"{name} {first}-{last}"] if (first, last) != ANY_PORT else []
    return " ".join([*words, rule.kind or f"table {rule.table}"])


def _write_network(network: IPv4Network | None) -> str:
    """Write a network as `ip rule` does: one address has no length."""
    return "all" if network is None else str(network).removesuffix("/32")


def _network(text: str) -> IPv4Network | None:
    return None if text == "all" else IPv4Network(text, strict=False)
