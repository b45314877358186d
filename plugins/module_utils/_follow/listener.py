# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The process that sees the packets of a run on this computer. It ends by itself: after its time, or when it was asked."""

import collections
import select
import socket
import time
import typing

from .._machine.network import neighbours
from .._process.background import admit, answer, remove_door
from .capture import Capture, Tag, read_packets
from .counters import find_growth, read_counters
from .drops import DropReasons

MOST = 500  # packets that are kept of each protocol: a flood of ARP hides no answer
AT_ONCE = 200  # that are read in one turn
MOST_COUNTERS = 60

Reply = typing.Dict[str, typing.Any]


def serve(link: socket.socket, door: socket.socket, path: str, tag: Tag, lifetime: float) -> None:
    """See packets until the time is over, or a visitor asks for them."""
    until, before = time.monotonic() + lifetime, read_counters()
    seen: typing.List[Capture] = []
    counts: typing.Counter[str] = collections.Counter()  # of each protocol
    try:
        with DropReasons() as drops:
            while time.monotonic() < until:
                ready = select.select([link, door], [], [], max(0.0, until - time.monotonic()))[0]
                for found in read_packets(link, tag, AT_ONCE) if link in ready else ():
                    counts[found.protocol] += 1
                    if counts[found.protocol] <= MOST:
                        seen.append(found)
                if door in ready:
                    connection, _request = admit(door)
                    grown = {**find_growth(before, read_counters()), **drops.read()}
                    answer(connection, report(seen, sum(counts.values()) - len(seen), grown))
                    return
    finally:
        remove_door(path)


def report(seen: typing.Sequence[Capture], missed: int, grown: typing.Dict[str, int]) -> Reply:
    """Return what was seen, as the module returns it."""
    counters = [{"counter": name, "more": more} for name, more in sorted(grown.items())[:MOST_COUNTERS]]
    fixed = [hardware for hardware, by_hand in neighbours().values() if by_hand]
    return {"seen": [dict(one._asdict()) for one in seen], "missed": missed, "counters": counters, "fixed": fixed}
