# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The process that sees the packets of a run on this computer. It ends by itself: after its time, or when it was asked."""

import collections
import select
import socket
import time
import typing

from ..._base.background import admit, answer, remove_door
from ..._machine.network import UpperInterface, neighbours, read_ports
from .capture import Capture, Tag, count_lost, read_packets
from .counters import Counters, find_growth, read_counters
from .drops import DropReasons

# Packets that are kept of each protocol, and of one source among them: neither a flood of ARP nor one stranger hides an answer.
MOST, MOST_OF_ONE = 500, 100
AT_ONCE = 200  # that are read in one turn
LAST = 20_000  # that are read of those that wait in the end
MOST_COUNTERS = 60

Reply = typing.Dict[str, typing.Any]


class Packets:
    """The packets that were seen, and how many more there were."""

    def __init__(self) -> None:
        self.kept: typing.List[Capture] = []
        self.missed = 0  # beyond MOST
        self.full: typing.Set[str] = set()  # addresses that have sent more than MOST_OF_ONE; MOST bounds them
        self._counts: typing.Counter[typing.Tuple[str, ...]] = collections.Counter()

    def take(self, found: Capture) -> None:
        """Take a packet."""
        source = found.reporter or found.source
        places = (found.protocol,), (found.protocol, source)
        if self._counts[places[1]] >= MOST_OF_ONE:
            self.full.add(source)
        elif self._counts[places[0]] >= MOST:
            self.missed += 1
        else:
            self._counts.update(places)
            self.kept.append(found)


def serve(link: socket.socket, door: socket.socket, path: str, tag: Tag, lifetime: float, before: Counters) -> None:
    """See packets until the time is over, or a visitor asks for them. `before`: the counters at the start."""
    packets, own_ports = Packets(), read_ports()
    try:
        with DropReasons() as drops:
            connection = _listen(link, door, tag, packets, time.monotonic() + lifetime, own_ports)
            if connection is None:
                return
            grown = {**find_growth(before, read_counters()), **drops.read()}
    finally:
        remove_door(path)
    for found in read_packets(link, tag, LAST, own_ports):
        packets.take(found)
    packets.missed += count_lost(link)
    # Nothing is left of it here by now: who asks may begin another one.
    answer(connection, report(packets, grown))


def _listen(
    link: socket.socket,
    door: socket.socket,
    tag: Tag,
    packets: Packets,
    until: float,
    own_ports: typing.Mapping[str, UpperInterface],
) -> typing.Optional[socket.socket]:
    """Take packets until a visitor comes; returns its connection, None after the time."""
    while time.monotonic() < until:
        ready = select.select([link, door], [], [], max(0.0, until - time.monotonic()))[0]
        for found in read_packets(link, tag, AT_ONCE, own_ports) if link in ready else ():
            packets.take(found)
        visitor = admit(door) if door in ready else None
        if visitor:
            return visitor[0]
    return None


def report(packets: Packets, grown: typing.Dict[str, int]) -> Reply:
    """Return the packets that were seen, as the module returns them."""
    named = sorted(grown.items(), key=lambda item: (not item[0].startswith("rule of "), item))  # rules say most
    counters = [{"counter": name, "more": more} for name, more in named[:MOST_COUNTERS]]
    fixed = [hardware for hardware, by_hand in neighbours().values() if by_hand]
    seen = [dict(one._asdict()) for one in packets.kept]
    return {"seen": seen, "missed": packets.missed, "full": sorted(packets.full), "counters": counters, "fixed": fixed}
