# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Consequences of the faults that values show: names that lead nowhere, and packets that end in the world as it was read. Pure."""

from __future__ import annotations

from collections.abc import Iterable

from ..checks.engine import Row, Verification
from ..components.component import Component
from ..context.actual_world import ActualWorld
from ..context.packet_filters import ROSCORE
from ..trace.place import Trip
from ..trace.probes import find_trip

# Checks that no packet filter is blamed for, and the packets that take the same way.
WAYS = {
    "route": "icmp",
    "outer_route": "udp",
    "master_route": "rpc",
    "ping_name": "icmp",
    "source": "udp",
    "clock": "rpc",
    "roscore_port": ROSCORE,
}
BY_NAME = (ROSCORE, "nodes")  # connections that begin with the name of a computer, and with a URI


class Effects:
    """The causes of failures among the faults that are known."""

    def __init__(self, verification: Verification, broken: Iterable[Component]) -> None:
        known = list(broken)
        self.verification = verification
        self.names = [
            component for component in known if component.kind in ("names", "environment") and component.mode != "own"
        ]
        self.world = ActualWorld(verification.state, known)
        self.causes: dict[Trip, Component | None] = {}

    def find_cause(self, row: Row, suspects: Iterable[Component]) -> Component | None:
        """Find the known fault that ends something that a failed check has sent, or that the nodes send which it needs."""
        for trip in _list_trips(self.verification, row, suspects):
            if trip not in self.causes:
                self.causes[trip] = self._find_wrong_name(trip) or self.world.find_fault(
                    trip.sender, trip.target, trip.traffic
                )
            if cause := self.causes[trip]:
                return cause
        return None

    def _find_wrong_name(self, trip: Trip) -> Component | None:
        """Find the fault of the name or the variable by which the connection of a trip begins."""
        if trip.traffic not in BY_NAME:
            return None
        variables = trip.sender if trip.traffic == ROSCORE else trip.target  # its own, and the URI of the other's node
        wrong = {("names", trip.sender, trip.target), ("environment", variables, "")}
        return next(
            (
                component
                for component in self.names
                if (component.kind, component.place, component.what if component.kind == "names" else "") in wrong
            ),
            None,
        )


def _list_trips(verification: Verification, row: Row, suspects: Iterable[Component]) -> Iterable[Trip]:
    """List the needs of a check on the network: its own packets, and the calls of the nodes that it suspects."""
    own = find_trip(verification, row)
    if own is not None:
        yield own
    if row.check in WAYS:
        yield Trip(WAYS[row.check], row.observer, row.target)
    master, other = map(verification.ways.master_of, (row.observer, row.target))
    for kind, place in sorted(
        {(component.kind, component.place) for component in suspects if component.mode == "hung"}
    ):
        if kind == "roscore":
            yield Trip(ROSCORE, row.target if place == other != master else row.observer, place)
        else:
            yield Trip(ROSCORE, place, place)
            yield Trip("rpc", master, place)
