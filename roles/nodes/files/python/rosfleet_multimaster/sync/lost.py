# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The connections with lost masters, ended so that nothing waits for TCP (see sync/core/losses.py).

Another process ends them (sync/ending.py): a node has no rights beyond those of an ordinary user.
"""

from functools import partial
from typing import Callable, Dict, FrozenSet, List, Mapping, Optional, Set, Tuple

from ..edge import connections
from ..edge.clock import monotonic
from ..edge.loop import Loop, RecurringJob, Workers
from ..edge.process import program
from ..edge.rpc_client import Rpc
from ..protocol.imports import Claims
from ..protocol.members import Members
from ..protocol.messages import Registration
from ..protocol.xml_rpc import NODE
from . import ending
from .core.losses import Connection, Disconnection, Look, Losses, connections_of
from .core.sync import View

QUESTION_TIMEOUT = 2.0  # seconds for the connections of an own node
SWEEP, SWEEP_AGAIN = 1.0, 0.1  # seconds between two looks for connections to lost masters, and where there were some
LINES = 50  # log lines of one look
NOTE = 0.5  # seconds from a registration to its note at most: it takes a look at all of them


class Lost:
    """Notes and ends connections. Does nothing where this service may not end any."""

    def __init__(
        self,
        loop: Loop,
        askers: Workers,
        limited: program.LimitedLog,
        wanted: bool,
        members: Members,
        online: Callable[[], Dict[str, bool]],
    ) -> None:
        """`wanted`: the parameter; `online()`: URI of each known master -> whether it is online."""
        self._losses = Losses(members)
        self._limited, self._online = limited, online
        self._active = wanted and _possible()
        self._askers = askers
        self._enders = Workers(loop, 1)  # of connections: never behind what may hang
        self._resolvers = Workers(loop, 2)  # name servers know no time limit
        self._endpoints: Set[Tuple[str, int]] = set()  # what leads there is ended
        self._latest: Optional[Tuple[Mapping[Registration, str], View, Claims]] = None  # registered, not noted yet,
        self._note_due = 0.0  # and when it is
        self._sweeps = RecurringJob(
            self._enders, lambda: SWEEP, self._sweep, self._swept, lambda: bool(self._endpoints)
        )

    def look(self, now: float) -> None:
        """See which masters were lost or have come back. Called after each news of them: two may come in one pass."""
        if not self._active:
            return
        self._note(now)
        looks, endings = self._losses.update(self._online(), now)
        for look in looks:
            self._sweeps.due = now
            for _name, uri in look.nodes:
                self._askers.submit(partial(_connections_with, look, uri), partial(self._noted, look.master))
        for noted in endings:
            self._enders.submit(partial(_end, noted), self._ended)
        self._endpoints = self._losses.endpoints()

    def tick(self, now: float) -> Optional[float]:
        """End what leads to lost masters where that is due; the time of the next call."""
        if not self._active:
            return None
        if self._latest is not None and now >= self._note_due:
            self._note(now)
        due = [self._sweeps.tick(now), None if self._latest is None else self._note_due]
        return min((time for time in due if time is not None), default=None)

    def registered(self, held: Mapping[Registration, str], view: View, claims: Claims, now: float) -> None:
        """Note what is registered for whom, and where its hosts are while that can still be found out: soon, or before a loss."""
        if self._active:
            self._note_due = now + NOTE if self._latest is None else self._note_due
            self._latest = (held, view, claims)
            if self._endpoints:  # who was lost may be there again as somebody else, at the same port
                self._note(now)

    def _note(self, now: float) -> None:
        if self._latest is not None:
            self._losses.take_registrations(*self._latest)
            self._latest = None
            for host in self._losses.to_resolve(now):
                self._resolve(host)
            self._endpoints = self._losses.endpoints()

    def _resolve(self, host: str) -> None:
        def resolved(found: Optional[FrozenSet[str]], _problem: Optional[Exception]) -> None:
            if found:
                self._losses.take_addresses(host, found, monotonic())
                self._endpoints = self._losses.endpoints()

        self._resolvers.submit(lambda: connections.addresses_of(host), resolved)

    def _noted(self, master: str, found: Optional[Set[Connection]], _problem: Optional[Exception]) -> None:
        self._losses.take_connections(master, found or set())

    def _sweep(self) -> List[ending.Pair]:
        """End what waits for the nodes of lost masters, whichever process of this computer has it."""
        endpoints = self._endpoints
        return ending.end(lambda found: found.remote in endpoints)

    def _swept(self, ended: Optional[List[ending.Pair]], problem: Optional[Exception]) -> None:
        if ended:  # the roscore may have a queue of what leads there
            self._sweeps.due = monotonic() + SWEEP_AGAIN
        self._ended(ended, problem)

    def _ended(self, ended: Optional[List[ending.Pair]], problem: Optional[Exception]) -> None:
        for (_address, port), remote in (ended or [])[:LINES]:
            program.LOG.info("the connection from port %d to %s:%d is ended", port, *remote)
        if problem is not None:
            self._limited.say("warning", "end", f"connections with lost robots cannot be ended: {problem}")


def _possible() -> bool:
    try:
        problem = ending.ask([]).problem
    except OSError as error:
        problem = f"multimaster-connections.service does not answer: {error}"
    if problem:
        program.LOG.info("connections with lost robots are left to TCP: %s", problem)
    return not problem


def _connections_with(look: Look, node_uri: str) -> Set[Connection]:
    """The connections of an own node with the nodes of a master."""
    answer = Rpc(node_uri, QUESTION_TIMEOUT, NODE).call("getBusInfo", "/rosfleet")
    return connections_of(answer[2] if isinstance(answer, list) and len(answer) == 3 else [], look.others)


def _end(noted: Disconnection) -> List[ending.Pair]:
    return ending.end(lambda found: noted.wants(found.local[1], found.remote, found.silent))
