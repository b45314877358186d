# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""From the place where packets end to the components that may be broken there. Pure.

A packet that was seen to leave a computer has passed its packet filter, and one that did not come in cannot have met the next one's. So a
stage leaves few kinds of components; an errno, an ICMP error or a counter may leave one. If no component that a check
suspects is left, the place itself is the component.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from typing import NamedTuple

from ..._faults.filters import LARGE
from ..components.component import Component
from ..context.errors import PROGRAMS, list_own_components
from ..observe.packet_trace import SeenPackets
from .place import LossPlace, TraceStage

# Where a component is: at the place, at the next computer, or a network between them
AT, NEXT, BETWEEN = "at", "next", "between"
# stage -> (where a component is, its kind, the modes that it may have; empty for all of them)
CONSISTENT: Mapping[TraceStage, tuple[tuple[str, str, tuple[str, ...]], ...]] = {
    TraceStage.SOURCE: (
        (AT, "filter", ("out", "changed", "pair")),
        (AT, "route", ()),
        (AT, "link", ("down",)),
        (AT, "interface", ("address", "port", "multicast")),
        (AT, "computer", ("ports", "limit")),
    ),
    TraceStage.ASKED: (
        (AT, "link", ("down",)),
        (AT, "interface", ("prefix", "port")),
        (NEXT, "link", ("down",)),
        (NEXT, "computer", ("off",)),
        (NEXT, "interface", ("address", "prefix")),
        (AT, "neighbour", ("filter",)),
        (NEXT, "neighbour", ("mute", "filter")),
        (BETWEEN, "network", ("dead",)),
    ),
    TraceStage.WIRE: (
        (AT, "link", ()),
        (AT, "interface", ("mtu",)),
        (AT, "neighbour", ("fixed",)),
        (NEXT, "link", ()),
        (NEXT, "interface", ("mtu", "duplicate")),
        (NEXT, "computer", ("off",)),
        (BETWEEN, "network", ()),
    ),
    TraceStage.STRANGER: ((AT, "neighbour", ("fixed",)), (NEXT, "interface", ("duplicate",))),
    TraceStage.SELF: ((AT, "link", ()), (AT, "neighbour", ("fixed",))),
    TraceStage.HOP: (
        (AT, "forwarding", ()),
        (AT, "filter", ("forward", "changed", "pair")),
        (AT, "reverse_path", ()),
        (AT, "route", ()),
        (AT, "service", ()),
    ),
    TraceStage.TARGET: (
        (AT, "filter", ("in", "out", "", "changed", "pair")),
        (AT, "reverse_path", ()),
        (AT, "route", ()),
        (AT, "setting", ("icmp_all",)),
        (AT, "interface", ("port",)),
    ),
    # The listener sees a packet before the packet filter of its computer.
    TraceStage.WITHHELD: ((AT, "filter", ("in", "", "changed", "pair")), (AT, "reverse_path", ())),
    TraceStage.CIRCLE: ((AT, "route", ()),),
    TraceStage.MUTE: ((AT, "roscore", ("hung",)), (AT, "discovery", ("hung",))),
    TraceStage.REPORTED: (
        (AT, "filter", ("forward", "in", "", "pair")),
        (AT, "route", ()),
        (AT, "link", ("down",)),
        (AT, "interface", ("address", "port", "prefix", "mtu")),
        (AT, "forwarding", ("large",)),
    ),
}

BETWEEN_TWO = (TraceStage.WIRE, TraceStage.ASKED, TraceStage.CUT, TraceStage.MUTE, TraceStage.STRANGER)
RULE = "rule of "  # begins the name of a rule among the counters
OWN_CHAIN = re.compile(r"rule of \S+ [^ :]*(?:input|output)[^ :]*:", re.IGNORECASE)
EXCEEDED = 11  # the type of ICMP for a time to live that is used up (RFC 792)
SHORT = 32  # a packet that begins with less has a time to live that a person or a program has set


def is_consistent(component: Component, place: LossPlace) -> bool:
    """Return True if a component may be the reason why packets end at a place."""
    rows = CONSISTENT.get(place.stage, ())
    return any(_is_there(component, where, place) and _fits(component, kind, modes) for where, kind, modes in rows)


def _is_there(component: Component, where: str, place: LossPlace) -> bool:
    if where == BETWEEN:
        return component.kind == "network"
    return (place.at if where == AT else place.next) in component.places


def _fits(component: Component, kind: str, modes: tuple[str, ...]) -> bool:
    """The last word of a filter's mode is its direction; without one it drops both."""
    if component.kind != kind or not modes:
        return component.kind == kind
    if component.kind != "filter" or component.mode in ("forward", "changed", "pair"):
        return component.mode in modes
    direction = component.mode.rpartition(" ")[2] if " " in component.mode else ""
    return direction in modes or not direction


def name_place(place: LossPlace, words: str) -> Component:
    """Make the component that is the place itself, with the observation there in words."""
    other = place.probe.sender if place.stage == TraceStage.MUTE else place.next
    if place.stage in BETWEEN_TWO and other:  # only one of the two shows packets that others do not see
        return Component.from_pair("way", "between", place.at, other, what=words)
    return Component("way", place.at, "ends", words)


# The meaning of an errno, an ICMP error or a counter, with the place


class Sign(NamedTuple):
    """A sign that makes a place one component of the table of faults."""

    stages: tuple[TraceStage, ...]
    is_shown: Callable[[LossPlace, SeenPackets], bool]
    make: Callable[[LossPlace], Component]


def _list_own_components(place: LossPlace) -> list[Component]:
    return list_own_components(place.sent.outcome, place.at, _name_traffic(place)) if place.sent else []


def _has_own_error(place: LossPlace, _packets: SeenPackets) -> bool:
    """Return True if the sender's own kernel has refused to send, by a component that is the only one, or that the probe cannot read."""
    components = _list_own_components(place)
    return len(components) == 1 or any(not component.fault.read for component in components)


def _began_short(place: LossPlace, _packets: SeenPackets) -> bool:
    """Return True if a router reports that the life of a packet was used up, and its sender gave it a short one (`first_ttl`)."""
    exceeded = place.last is not None and place.last.icmp_type == EXCEEDED
    return exceeded and 0 < place.first_ttl < SHORT


def _ends_life(place: LossPlace, _packets: SeenPackets) -> bool:
    """Return True if a packet came in with a time to live of 1, so that no router passes it on."""
    return place.last is not None and not place.last.outgoing and place.last.ttl == 1


def _list_counted(place: LossPlace, packets: SeenPackets) -> list[str]:
    """List the counters that have grown by at least as many packets as were seen at the place; a smaller count is that of foreign packets."""
    return [one.counter for one in packets.counters if one.more >= max(1, place.times)]


def _counts_reverse_path(place: LossPlace, packets: SeenPackets) -> bool:
    return "TcpExtIPReversePathFilter" in _list_counted(place, packets)


def _counts_rule(place: LossPlace, packets: SeenPackets) -> bool:
    """Return True if a rule that drops or rejects has counted them all. At their target it must name them: broadcasts are dropped there, too."""
    named = re.compile(rf"\b{place.probe.port or place.probe.protocol}\b")
    counted = [counter for counter in _list_counted(place, packets) if RULE in counter]
    if place.stage == TraceStage.HOP:  # chains for the gateway's own packets do not see those that it passes on
        return any(not OWN_CHAIN.search(rule) for rule in counted)
    return any(map(named.search, counted))


def _counts_full_queue(place: LossPlace, packets: SeenPackets) -> bool:
    """Return True if a program takes no connections any more, so its queue is full (listen(2)). ListenDrops also counts answers without a way."""
    return bool(_name_program(place)) and "TcpExtListenOverflows" in _list_counted(place, packets)


def _name_program(place: LossPlace) -> str:
    return PROGRAMS.get(place.probe.traffic, "")


def _is_fixed(place: LossPlace, packets: SeenPackets) -> bool:
    return place.last is not None and place.last.target_mac in packets.fixed


def _make_lifetime(place: LossPlace) -> Component:
    return Component("setting", place.probe.target if place.answer else place.probe.sender, "ttl")


def _name_traffic(place: LossPlace) -> str:
    return "icmp" if place.probe.traffic == LARGE else place.probe.traffic


SIGNS = (
    Sign((TraceStage.SOURCE,), _has_own_error, lambda place: _list_own_components(place)[0]),
    Sign(
        (TraceStage.STRANGER, TraceStage.WIRE),
        _is_fixed,
        lambda place: Component("neighbour", place.at, "fixed", place.next or "a computer"),
    ),
    Sign((TraceStage.REPORTED,), _began_short, _make_lifetime),
    Sign((TraceStage.HOP,), _ends_life, _make_lifetime),
    Sign(
        (TraceStage.HOP, TraceStage.TARGET, TraceStage.WITHHELD),
        _counts_reverse_path,
        lambda place: Component("reverse_path", place.at, "strict"),
    ),
    Sign((TraceStage.HOP,), _counts_rule, lambda place: Component("filter", place.at, "forward")),
    Sign((TraceStage.TARGET,), _counts_rule, lambda place: Component("filter", place.at, f"{_name_traffic(place)} in")),
    Sign((TraceStage.TARGET,), _counts_full_queue, lambda place: Component(_name_program(place), place.at, "hung")),
)


def find_sign(place: LossPlace, packets: SeenPackets) -> Component | None:
    """Return the one component of the table that is shown by a place, and by the values of its computer; None if several are left."""
    return next(
        (sign.make(place) for sign in SIGNS if place.stage in sign.stages and sign.is_shown(place, packets)), None
    )
