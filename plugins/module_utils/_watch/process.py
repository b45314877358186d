# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause
"""The process of a watch: its sockets, and its loop; watch.py decides what they mean.

It hears the heartbeats of discovery on a raw socket, which gives copies of datagrams and takes none away. It does not join
the group: a join would tell a switch with IGMP snooping what the switch had forgotten, and hide what is looked for.
"""

import queue
import select
import socket
import struct
import threading
import time
import typing

from .._multicast.helper_process import filter_port
from .._multicast.packets import packet
from .._process.background import admit, answer, remove_door
from .readings import LastLook, Targets, read_all
from .watch import Watch

LOOK = 3.0  # seconds between two looks at the parts of this computer
TURN = 0.5  # seconds between two searches for silent computers
UDP_HEADER = 8
RECORD = 24  # bytes of a heartbeat
MARK = b"R"
AT_ONCE = 1000  # datagrams that are read in one turn

Sources = typing.Mapping[str, str]  # address -> computer


class Visitor(typing.NamedTuple):
    """A visitor that waits for the next loss, until a time (monotonic seconds)."""

    connection: socket.socket
    until: float


def heartbeats_socket(port: int) -> socket.socket:
    """Open the raw socket for datagrams to a port. Raises OSError."""
    raw = socket.socket(socket.AF_INET, socket.SOCK_RAW, socket.IPPROTO_UDP)
    try:
        raw.setblocking(False)
        filter_port(raw, port)
    except OSError:
        raw.close()
        raise
    return raw


class Beat(typing.NamedTuple):
    """A heartbeat as it arrived."""

    source: str
    destination: str
    rate: float  # heartbeats a second that it promises


def heartbeat(data: bytes, port: int) -> typing.Optional[Beat]:
    """Read a heartbeat of discovery (24 bytes, docs/understand/protocol.md) out of an IPv4 packet; None for anything else."""
    found = packet(data)
    if found is None or len(found.body) < UDP_HEADER + RECORD:
        return None
    _origin, target, length = struct.unpack("!HHH", found.body[:6])
    record = found.body[UDP_HEADER:]
    if target != port or length != UDP_HEADER + RECORD or record[:1] != MARK:
        return None
    return Beat(found.source, found.destination, record[2] / 10)


def read_beats(raw: socket.socket, port: int) -> typing.Iterator[Beat]:
    """Yield the heartbeats that wait in a raw socket."""
    for _unused in range(AT_ONCE):
        try:
            data = raw.recv(128)
        except OSError:
            return
        found = heartbeat(data, port)
        if found:
            yield found


class Looks:
    """Looks at the parts of this computer, in a thread: a command that hangs must not make others look silent."""

    def __init__(self, targets: Targets) -> None:
        self._targets = targets
        self._before = LastLook(time.monotonic(), time.time())
        self._done: queue.Queue = queue.Queue()
        self._busy = False
        self._due = 0.0

    def begin(self, now: float) -> None:
        """Begin a look where one is due."""
        if not self._busy and now >= self._due:
            self._busy, self._due = True, now + LOOK
            thread = threading.Thread(target=lambda: self._done.put(read_all(self._targets, self._before)))
            thread.daemon = True
            thread.start()

    def results(self) -> typing.Iterator[typing.Dict[typing.Tuple[str, str], str]]:
        """Yield what was seen since."""
        while not self._done.empty():
            yield self._done.get()
            self._busy = False


def serve(raw: socket.socket, door: socket.socket, path: str, targets: Targets, port: int, lifetime: float) -> None:
    """Watch until the lifetime is over, or a visitor ends it."""
    sources = {address: computer for computer, address, _port in targets.masters if address not in targets.addresses}
    watch, looks = Watch(time.monotonic(), time.time()), Looks(targets)
    until = watch.began + lifetime
    waiting: typing.List[Visitor] = []
    try:
        while time.monotonic() < until:
            looks.begin(time.monotonic())
            ready = select.select([raw, door], [], [], TURN)[0]
            _hear(watch, read_beats(raw, port), sources, targets.group)
            lost = watch.beat(time.monotonic(), time.time())
            for values in looks.results():
                lost = watch.read(time.time(), values) or lost
            if door in ready:
                connection, request = admit(door)
                if request.get("do") == "end":
                    waiting.append(Visitor(connection, 0.0))
                    return
                waiting.append(Visitor(connection, watch.began + float(request.get("until", 0))))
            waiting = _reply(watch, waiting, lost)
    finally:
        remove_door(path)
        _reply(watch, waiting, True)


def _hear(watch: Watch, beats: typing.Iterable[Beat], sources: Sources, group: str) -> None:
    for beat in beats:
        if beat.source not in sources:
            continue
        # A node that sends to the group sometimes also answers a direct question. So only the group has a rhythm.
        for kind in ("group", "master") if beat.destination == group else ("master",):
            watch.hear(time.monotonic(), kind, sources[beat.source], beat.rate)


def _reply(watch: Watch, waiting: typing.List[Visitor], lost: bool) -> typing.List[Visitor]:
    """Answer those who have waited long enough, or all after a loss; return the others."""
    now = time.monotonic()
    for visitor in waiting:
        if lost or now >= visitor.until:
            answer(visitor.connection, watch.report(now))
    return [visitor for visitor in waiting if not lost and now < visitor.until]
