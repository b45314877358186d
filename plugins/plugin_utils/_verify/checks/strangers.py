# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The check of strangers: computers outside the fleet on its multicast group."""

from __future__ import annotations

from ipaddress import IPv4Address
from urllib.parse import urlsplit

from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.case import Case
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.engine import (
    COMPUTER,
    OK,
    WARNING,
    Cause,
    Check,
    Documented,
    Judgement,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observations import Outsider


def _strangers(case: Case) -> Judgement | None:
    multicast, listed = case.observer.seen.multicast, case.observer.listed
    if case.probe is None or not (multicast or listed):
        return None
    planned = {master.name for master in case.fleet.masters}
    guests = {entry.name: _host(entry.monitoruri) for entry in listed.values() if entry.name not in planned}
    welcome = sorted(name for name, address in guests.items() if _allowed(case, address))
    ignored = [f"{_title(entry)} is ignored: {entry.why}" for entry in case.probe.outsiders]
    unwanted = [f"master {name} at {guests[name]}" for name in sorted(set(guests) - set(welcome))]
    named = {*guests.values(), *(entry.address for entry in case.probe.outsiders)}
    found = [*ignored, *unwanted, *_datagrams(case, named)]
    fine = f"only those, and the allowed {', '.join(welcome)}" if welcome else "only those"
    return Judgement(WARNING if found else OK, "only computers of the fleet", ", ".join(found) or fine)


def _datagrams(case: Case, named: set[str]) -> list[str]:
    """Return who else sends to the group, beside those that are named already."""
    multicast = case.observer.seen.multicast
    return [
        f"datagrams from {entry.address} on {entry.interface}"
        for entry in (multicast.unexpected if multicast else ())
        if entry.address not in named and not _allowed(case, entry.address)
    ]


def _title(entry: Outsider) -> str:
    return f"{entry.name or 'a sender of heartbeats'} at {entry.address}"


def _host(uri: str) -> str:
    try:
        return urlsplit(uri).hostname or ""
    except ValueError:
        return ""


def _allowed(case: Case, address: str) -> bool:
    """Return True if a master outside the inventory may be at this address."""
    if case.fleet.belonging.strangers == "allow":
        return True
    try:
        return any(IPv4Address(address) in network for network in case.fleet.belonging.allow)
    except ValueError:
        return False


STRANGERS = Check(
    id="strangers",
    title="nobody else is on the group",
    scope=COMPUTER,
    judge=_strangers,
    documented=Documented("computer", "nobody else on the group, no other master, none that is ignored (warning)"),
    causes=(
        Cause(
            "another fleet, or a computer that is not in the inventory, uses the same group and port",
            "add it to the inventory, put its address into multimaster_allow, or give this fleet another "
            "multimaster_multicast_group or port",
        ),
    ),
)


# In the order in which one failure can explain the next.
CHECKS = (STRANGERS,)
