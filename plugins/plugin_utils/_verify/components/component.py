# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The components of a fleet that a person can repair, and which fault follows from which. `_faults` has the ways in which each may be broken.

A component has a `kind`, a `place`, and the `mode` in which it is broken. `what` narrows it if a place has several: the network
of a link or a route, the name that is looked up, the port of a packet filter.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

from ..._faults.fault import Advices, Fault
from ..._faults.filters import DROPPED, LARGE, RULED
from ..._faults.table import FAULTS, HOOKS

__all__ = ("ANY", "FAULTS", "FOLLOWS", "HEARSAY", "RULED", "Component")


class Component(NamedTuple):
    """A component that may be broken in one way."""

    kind: str
    place: str  # a computer, a robot or a network
    mode: str
    what: str = ""
    other: str = ""  # the second place of a fault between two

    @classmethod
    def from_pair(cls, kind: str, mode: str, *places: str, what: str = "") -> Component:
        """Make the component between two places, in whatever order they come."""
        place, other = sorted(places)
        return cls(kind, place, mode, what, other)

    @property
    def places(self) -> tuple[str, ...]:
        """The place, or both."""
        return (self.place, self.other) if self.other else (self.place,)

    @property
    def place_text(self) -> str:
        """The places as a report has them."""
        return " and ".join(self.places)

    @property
    def fault(self) -> Fault:
        """The row of the table."""
        return FAULTS[self.kind, self.mode]

    def sentence(self) -> str:
        """Return the sentence of the fault."""
        return self.fault.sentence.format(place=self.place_text, what=self.what or self.fault.what)

    def do(self, inventory: str = "", known: Mapping[str, str] = MappingProxyType({})) -> Advices:
        """Return the commands for a fault that was seen. `known` has values for their words."""
        return self.fault.fill(self.fault.do, self.places, self.what, inventory, known)

    def look(self, inventory: str = "", known: Mapping[str, str] = MappingProxyType({})) -> Advices:
        """Return the commands to look with. They change nothing. `known` has values for their words."""
        return self.fault.fill(self.fault.look, self.places, self.what, inventory, known)


#: The reports of a router about others, which may be false: packets are followed all the same.
HEARSAY = {("route", "circle")}

ANY = "any computer of this run"  # the place of a fault that all of them have

#: The components that site.yml makes: on a computer where it never ran, no fault of these is worth a finding of its own.
MADE = (
    *(("names", mode) for mode in ("unknown", "loopback", "own", "old", "several")),
    *(("route", mode) for mode in ("missing", "other")),
    ("forwarding", "off"),
    ("reverse_path", "strict"),
    ("redirects", "sent"),
    *(("environment", mode) for mode in ("service", "shell")),
    *(("roscore", mode) for mode in ("dead", "name")),
    *((node, mode) for node in ("discovery", "sync") for mode in ("dead", "configuration")),
    *(("service", mode) for mode in ("down", "missing")),
    *(("registration", mode) for mode in ("talker", "listener")),
    ("filter", "changed"),
    ("setting", "icmp_group"),
    *(("boot", mode) for mode in ("unit", "sysctl", "route", "names")),
)
PORTS, LIMIT = ("computer", "ports"), ("computer", "limit")
#: The components that need a new connection of a computer.
CALLS = (
    *((node, mode) for node in ("roscore", "discovery", "sync") for mode in ("dead", "hung")),
    *((node, "stale") for node in ("discovery", "sync")),
    *(("registration", mode) for mode in ("talker", "listener")),
    *(("filter", f"{mode} out") for mode in ("rpc", "roscore", "nodes", "all")),
)
STOPPED, LOOPING = ("service", "stopped"), ("service", "looping")
STANDSTILL = (STOPPED, ("service", "full"), LOOPING)  # in one of these a node gives no answers
SEALED = ("roscore", "sealed")
_CAUSES: Mapping[tuple[str, str], tuple[tuple[str, str], ...]] = {
    **{(node, "hung"): STANDSTILL for node in ("discovery", "sync")},
    ("roscore", "hung"): (*STANDSTILL, ("filter", "roscore in"), ("filter", "all in")),
    **{
        (node, "stale"): (
            *STANDSTILL,
            *((name, mode) for name in (node, "roscore") for mode in ("dead", "hung")),
            SEALED,
        )
        for node in ("discovery", "sync")
    },
    **dict.fromkeys((("registration", "talker"), ("registration", "listener")), STANDSTILL),
    **{
        ("filter", f"{mode} {way}"): tuple(
            ("filter", more) for more in (mode, f"all {way}", "all") if more != f"{mode} {way}"
        )
        for mode in DROPPED
        if mode != LARGE  # a rule for the size is not the one that drops other packets, too
        for way in ("in", "out")
    },
    **{("filter", f"{LARGE} {way}"): (("filter", LARGE),) for way in ("in", "out")},
    ("sync", "untold"): (*STANDSTILL, ("sync", "dead")),
    ("computer", "unmeasured"): (("link", "down"), ("interface", "address"), PORTS),
    ("set_up", "by_hand"): (("set_up", "others"),),
    ("set_up", "refused"): (("ros", "broken"),),
    LOOPING: (("ros", "broken"),),
    ("neighbour", "mute"): (("neighbour", "filter"),),
    ("roscore", "dead"): (("interface", "duplicate"),),  # the other computer refuses
    ("discovery", "dead"): (("roscore", "dead"), SEALED, LOOPING),
    # A node whose datagrams its own kernel refuses leaves the group, and tries again.
    ("discovery", "group"): (("filter", "group out"), ("filter", "group"), ("filter", "udp out"), ("filter", "udp")),
    ("sync", "dead"): (("roscore", "dead"), SEALED, LOOPING),
    # systemd ends a stopped process and starts it again, and its neighbours with it: they know little at first.
    ("service", "restarting"): (
        *STANDSTILL,
        ("roscore", "dead"),
        ("roscore", "hung"),
        SEALED,
        ("set_up", "others"),
    ),
    **dict.fromkeys((("discovery", "configuration"), ("sync", "configuration")), (STOPPED, LOOPING)),
    **{("names", mode): (("names", "order"),) for mode in ("unknown", "old", "several")},
    ("roscore", "name"): (("environment", "service"),),
    # A packet that comes in elsewhere, as at a port that was taken out of a bridge, is of no use while the planned interface has no link.
    ("interface", "multicast"): (("interface", "address"), ("interface", "port"), ("link", "down")),
    ("interface", "overlap"): (("interface", "address"),),
    ("route", "missing"): (
        ("route", "closed"),
        ("route", "rule"),
        ("interface", "overlap"),
        ("link", "down"),
        ("interface", "address"),
        ("interface", "prefix"),
    ),
    ("route", "other"): (
        ("route", "rule"),
        ("route", "defaults"),
        ("interface", "overlap"),
        ("interface", "address"),
        ("interface", "prefix"),
    ),
}

#: A fault that follows from another fault of the same place: fault -> its possible causes.
FOLLOWS = {
    fault: (
        *_CAUSES.get(fault, ()),
        *(cause for hooks in HOOKS for cause in hooks.causes.get(fault, ())),
        *([("set_up", "never")] if fault in MADE else []),
        *([PORTS, LIMIT] if fault in CALLS else []),
    )
    for fault in dict.fromkeys((*_CAUSES, *MADE, *CALLS, *(fault for hooks in HOOKS for fault in hooks.causes)))
}
