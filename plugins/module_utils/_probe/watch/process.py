# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause
"""The process of a watch: its sockets, and its loop; watch.py interprets them.

It hears the heartbeats of discovery on a raw socket, which gives copies of datagrams and takes none away. It does not join
the group: a join would remind a switch with IGMP snooping of the group, and hide the fault that is looked for.
"""

import math
import queue
import select
import socket
import threading
import time
import typing

from ..._base.background import admit, answer, remove_door
from ..multicast.packets import UdpDatagram, read_copies
from .readings import LastLook, Params, Values, read_all, read_clocks
from .watch import GOOD, Watch

LOOK = 3.0  # seconds between two looks at the parts of this computer
TURN = 0.5  # seconds between two searches for silent computers
SLOWEST = 15.0  # seconds until a loss is reported, and after which a look hangs
ABANDONED = 600.0  # seconds without a visitor, two of the longest rounds of the controller, after which it has vanished
READINGS = "readings", "readings"  # the kind and name of the value that says if the other values are read at all
RECORD = 24  # bytes of a heartbeat
MARK = b"R"

Visitor = typing.Tuple[socket.socket, float]  # it waits for the next loss, until a time (monotonic seconds)


def read_rate(found: UdpDatagram) -> typing.Optional[float]:
    """Read the heartbeats a second that a heartbeat of discovery promises (docs/understand/protocol.md); None for anything else."""
    record = found.payload[:RECORD]
    return record[2] / 10 if len(record) == found.length == RECORD and record[:1] == MARK else None


def look_once(params: Params, before: LastLook) -> Values:
    """Read all parts. An error is a value as well: without one, the values of before would count for ever."""
    try:
        return {**read_all(params, before), READINGS: GOOD[READINGS[0]]}
    except Exception as problem:
        return {READINGS: str(problem) or type(problem).__name__}


def look_for_ever(params: Params, results: typing.Any) -> None:
    """Put the time of each look at the parts of this computer, and its values, into a queue."""
    before = LastLook(*read_clocks())
    while True:
        began = time.monotonic()
        results.put((began, look_once(params, before)))
        time.sleep(max(0.0, began + LOOK - time.monotonic()))


class Looks:
    """The looks, in a thread: a command that hangs must not make others look silent."""

    def __init__(self, params: Params, now: float) -> None:
        self.results: typing.Any = queue.Queue()
        self.turn, self.waited = now, 0.0  # the time of the last turn, and the seconds since a look has ended
        threading.Thread(target=look_for_ever, args=(params, self.results), daemon=True).start()

    def take(self, now: float) -> typing.List[typing.Tuple[float, Values]]:
        """Return the looks that have ended. If no look ends for long, one says so."""
        # A process that is held up as a whole has missed no look, so each turn counts for little.
        self.waited, self.turn = self.waited + min(now - self.turn, 2 * TURN), now
        found = []
        while not self.results.empty():
            found.append(self.results.get())
            self.waited = 0.0
        if self.waited > SLOWEST:  # nothing that is nearer to the reason will come
            found.append((now, {READINGS: f"no look has ended for {SLOWEST:g} s"}))
        return found


def serve(raw: socket.socket, door: socket.socket, path: str, params: Params) -> None:
    """Watch until the lifetime is over, a visitor ends it, or visitors no longer come. `params`: the options of multimaster_watch."""
    watch = Watch(time.monotonic(), time.time())
    looks, visited = Looks(params, watch.began), watch.began  # a visitor is there until it has its answer
    waiting: typing.List[Visitor] = []
    alarm = math.inf  # when the first loss was found that is not reported yet
    try:
        while time.monotonic() < min(watch.began + params["lifetime"], visited + ABANDONED):
            ready = select.select([raw, door], [], [], TURN)[0]
            _hear(watch, raw, params)
            lost, looked = watch.beat(time.monotonic(), time.time()), -math.inf
            for began, values in looks.take(time.monotonic()):
                looked = began
                lost = watch.read(time.time(), values) or lost
            alarm = min(alarm, time.monotonic()) if lost else alarm
            visitor = admit(door) if door in ready else None
            if visitor:
                connection, request = visitor
                if request.get("do") == "end":
                    waiting.append((connection, 0.0))
                    return
                waiting.append((connection, watch.began + float(request.get("until", 0))))
                visited = min(max(waiting[-1][1], time.monotonic()), time.monotonic() + ABANDONED)
            # Not at once: a value nearer to the reason may show its loss only in a look that began after the loss.
            report = looked >= alarm or time.monotonic() > alarm + SLOWEST
            alarm = math.inf if report and waiting else alarm
            waiting = _reply(watch, waiting, report)
    finally:
        remove_door(path)
        _reply(watch, waiting, True)


def _hear(watch: Watch, raw: socket.socket, params: Params) -> None:
    computers = {master["address"]: str(master["computer"]) for master in params["masters"]}
    for found, _interface in read_copies(raw, params["port"]):
        rate, source = read_rate(found), found.source[0]
        if rate is None or source not in computers or source in params["addresses"]:
            continue
        # A node that sends to the group sometimes also answers a direct question. So only the group has a rhythm.
        for kind in ("group", "master") if found.destination == params["group"] else ("master",):
            watch.hear(time.monotonic(), kind, computers[source], rate)


def _reply(watch: Watch, waiting: typing.List[Visitor], report: bool) -> typing.List[Visitor]:
    """Answer those who have waited long enough, or all if a loss is to be reported; return the others."""
    now = time.monotonic()
    for connection, until in waiting:
        if report or now >= until:
            answer(connection, watch.report(now))
    return [(connection, until) for connection, until in waiting if not report and now < until]
