# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The check of strangers: computers outside the fleet on its multicast group."""

from __future__ import annotations

from ipaddress import IPv4Address

from ..._base.hosts import host_of
from ..._plan.model import COMMON
from ..context.check_context import CheckContext
from ..context.needs import Components, join_components, make_components
from ..observe.observations import IgnoredSender
from ..observe.uris import is_one_of
from .engine import WARNING, Check, Judgement, judge_fault


def _find_guests(context: CheckContext) -> dict[str, str]:
    """List the masters in the list that are not planned: name -> address."""
    planned = {master.name for master in context.fleet.masters}
    return {name: host_of(entry.monitoruri) for name, entry in context.observer.listed.items() if name not in planned}


def _datagrams(context: CheckContext, named: set[str]) -> list[str]:
    """Return who else sends to the group, except those that are named already."""
    return [
        f"datagrams from {entry.address} on {entry.interface}"
        for entry in context.observer.multicast.unexpected
        if entry.address not in named and not _is_allowed(context, entry.address)
    ]


def _title(entry: IgnoredSender) -> str:
    return f"{entry.name or 'a sender of heartbeats'} at {entry.address}"


def _is_allowed(context: CheckContext, address: str) -> bool:
    """Return True if a master outside the inventory may be at this address."""
    if context.fleet.belonging.strangers == "allow":
        return True
    try:
        return any(IPv4Address(address) in network for network in context.fleet.belonging.allow)
    except ValueError:
        return False


def _list_strangers(context: CheckContext) -> Components:
    """Each of them is one, by whomever it is seen."""
    outsiders = context.probe.outsiders
    found = {**_find_unwanted(context), **{entry.address: entry.name for entry in outsiders}}
    known = join_components(
        _misread_member_components(context, entry) for entry in outsiders if context.ways.name_at(entry.address)
    )
    strange = {at: name for at, name in found.items() if not context.ways.name_at(at)}
    return known | join_components(
        make_components("stranger", at or name, "present", what=name) for at, name in strange.items()
    )


def _find_unwanted(context: CheckContext) -> dict[str, str]:
    """List those on the group and in the list of masters that are neither planned nor allowed: address -> name."""
    senders = {entry.address: "" for entry in context.observer.multicast.unexpected}
    guests = {address: name for name, address in _find_guests(context).items()}
    return {at: name for at, name in {**senders, **guests}.items() if not _is_allowed(context, at)}


def _misread_member_components(context: CheckContext, entry: IgnoredSender) -> Components:
    """A computer of the fleet that is ignored: its master calls itself otherwise, or its gateway translates its address."""
    computer = context.ways.name_at(entry.address)
    master = context.ways.master_at.get(computer)
    if master is not None and not is_one_of(entry.uri, context.fleet.master_uris[master.robot]):
        return make_components("roscore", computer, "name", what=entry.uri)
    beyond = COMMON if computer in context.ways.titles else ""
    return make_components("translation", computer, "on", what=beyond)


@Check(
    title="nobody else is on the group",
    when=lambda context: (
        context.observer.is_probed and bool(context.observer.seen.multicast or context.observer.listed)
    ),
)
def _judge_strangers(context: CheckContext) -> Judgement:
    guests = _find_guests(context)
    welcome = sorted(name for name, address in guests.items() if _is_allowed(context, address))
    ignored = [f"{_title(entry)} is ignored: {entry.why}" for entry in context.probe.outsiders]
    unwanted = [f"master {name} at {guests[name]}" for name in sorted(set(guests) - set(welcome))]
    named = {*guests.values(), *(entry.address for entry in context.probe.outsiders)}
    found = [*ignored, *unwanted, *_datagrams(context, named)]
    fine = f"only those, and the allowed {', '.join(welcome)}" if welcome else "only those"
    return judge_fault(WARNING, "only computers of the fleet", ", ".join(found), fine, _list_strangers(context))
