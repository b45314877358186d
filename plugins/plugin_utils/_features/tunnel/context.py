# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The needs of packets between two computers in the tunnel."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import pairwise

from ..._verify.components.component import Component
from ..._verify.context.check_context import CheckContext
from ..._verify.context.hooks import ContextHooks
from ..._verify.context.needs import FORWARDER, Components, join_components, make_components
from .components import ENDED
from .model import Tunnel

MODES = ("ended", "peer", "key", "silent", "clock", "mtu", "beside")


def list_way_components(context: CheckContext, places: Iterable[str]) -> Components:
    """List the components of the tunnel between two computers of the common network, if that is one, and of its hub."""
    ends = [
        place for place in places if place in context.fleet.computers and Tunnel.find(context.fleet.computers[place])
    ]
    if len(ends) != 2:
        return frozenset()
    hub = _find_hub(context, *ends)
    stops = [ends[0], hub, ends[1]] if hub else ends
    own = join_components(make_components("tunnel", stop, *MODES) for stop in stops)
    own |= {Component(kind, hub, mode) for kind, mode in FORWARDER if hub}
    return own | {Component.from_pair("tunnel", "pair", *leg) for leg in pairwise(stops)}


def _find_hub(context: CheckContext, one: str, other: str) -> str:
    """Return the computer through which two reach each other in the tunnel; empty if they do so directly."""
    tunnel, target = (Tunnel.find(context.fleet.computers[name]) for name in (one, other))
    carrier = tunnel.find_carrier(target.address) if tunnel and target else ""
    return "" if carrier == other else carrier


def list_large_components(context: CheckContext, place: str) -> Components:
    """List the components that lose only large packets at the place of a tunnel."""
    plan = context.fleet.computers.get(place)
    return make_components("tunnel", place, "mtu") if plan and Tunnel.find(plan) else frozenset()


HOOKS = ContextHooks(
    list_way_components=list_way_components,
    list_large_components=list_large_components,
    list_route_components=lambda computer: make_components("tunnel", computer, "beside"),
    services={"tunnel": ENDED},
)
