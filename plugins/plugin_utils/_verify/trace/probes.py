# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The choice of the probes to trace: one probe for each way on which something failed that no value shows.

Pure: the failed rows in, probes and listeners out.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import zip_longest

from ..._faults.filters import LARGE
from ..checks.engine import FAILED, WARNING, Row, Verification
from ..components.component import Component
from ..context.packet_filters import GROUP, LARGE_SIZE, ROSCORE, TRAFFIC
from ..observe.packet_trace import TracedProbe
from .place import Trip

MOST = 12  # probes of one run
# The check of large packets: an error of it says nothing of the size, so it has no `carries`.
KINDS: Mapping[str, str] = {"ping_large": LARGE}


def find_trip(verification: Verification, row: Row) -> Trip | None:
    """Return the packets that a failed check has sent itself; None for a check that sends nothing of its own."""
    traffic = verification.checks[row.check].carries or KINDS.get(row.check, "")
    if not traffic or row.verdict not in (FAILED, WARNING):
        return None
    if traffic == GROUP:
        return Trip(traffic, row.target, row.observer)
    target = verification.ways.master_of(row.observer) if traffic == ROSCORE else row.target
    return Trip(traffic, row.observer, target)


def list_trips(verification: Verification, row: Row) -> list[Trip]:
    """List the failed packets of a check, as far as they can be traced: its own packets, then its questions to nodes."""
    if row.verdict not in (FAILED, WARNING):
        return []
    own, master = find_trip(verification, row), verification.ways.master_of(row.observer)
    suspects = verification.list_suspects(row)
    found = [own] if own else []
    if Component("roscore", master, "hung") in suspects:
        found.append(Trip(ROSCORE, row.observer, master))
    if Component("discovery", row.target, "hung") in suspects:
        found.append(Trip("rpc", row.observer, row.target))
    return [trip for trip in dict.fromkeys(found) if trip.sender != trip.target and _can_follow(verification, trip)]


def _can_follow(verification: Verification, trip: Trip) -> bool:
    return trip.sender in verification.run and trip.target in verification.ways.members


def choose_probes(verification: Verification, groups: Iterable[Sequence[Row]]) -> list[TracedProbe]:
    """Choose probes for rows that failed. Each group has the rows that one finding explains, and all groups are served in turn."""
    ways = [_list_ways(verification, group) for group in groups]
    turns = (trip for turn in zip_longest(*ways) for trip in turn if trip)
    chosen = list(dict.fromkeys(turns))[:MOST]
    return [_make_probe(verification, number, trip) for number, trip in enumerate(chosen)]


def _list_ways(verification: Verification, rows: Iterable[Row]) -> list[Trip]:
    """List one trip for each kind of packet and each two robots."""
    found: dict[tuple[str, str, str], Trip] = {}
    for trip in (trip for row in rows for trip in list_trips(verification, row)):
        robots = (verification.run[trip.sender].plan.robot, verification.ways.members[trip.target].robot)
        found.setdefault((trip.traffic, *robots), trip)
    return list(found.values())


def _make_probe(verification: Verification, number: int, trip: Trip) -> TracedProbe:
    fleet, member = verification.fleet, verification.ways.members[trip.target]
    packet = verification.state.filters.make_packet(member, trip.traffic)
    own = verification.ways.members.get(trip.sender)
    grouped = trip.traffic == GROUP
    return TracedProbe(
        number=number,
        sender=trip.sender,
        target=trip.target,
        traffic=trip.traffic,
        protocol=TRAFFIC[trip.traffic],
        address=str(fleet.multicast_group if grouped else packet.destination),
        port=fleet.multicast_port if grouped else packet.port,
        size=LARGE_SIZE if trip.traffic == LARGE else 0,
        interface_address=str(own.discovery_address) if grouped and own else "",
    )


def list_listeners(verification: Verification, probes: Iterable[TracedProbe]) -> list[str]:
    """Name the computers of the run that have an address on a network which one of the probes crosses."""
    ways = verification.ways
    links = (link for probe in probes for link in ways.list_links(probe.sender, probe.target))
    networks = {network for _place, network in links}
    return [name for name in verification.run if any(ways.is_in(name, network) for network in networks)]
