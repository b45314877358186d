# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Ends the connections with lost masters, so that nothing waits for TCP (see sync/core/losses.py).

A separate process ends them (connection_ender.py): a node has only the rights of an ordinary user.
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
from ..protocol.messages import Registration, View
from ..protocol.xml_rpc import NODE
from .connection_ender import Pair, ask, end
from .core.losses import Connection, Disconnection, Look, Losses, connections_of

QUESTION_TIMEOUT = 2.0  # seconds for the connections of an own node
SWEEP, SWEEP_AGAIN = (
    1.0,
    0.1,
)  # seconds between two sweeps of connections to lost masters, and after one that ended some
LINES = 50  # log lines of one sweep


class Disconnector:
    """Notes and ends connections. Does nothing if this service may not end any."""

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
        self._enders = Workers(loop, 1)  # of its own: never behind a call that may hang
        self._resolvers = Workers(loop, 2)  # name servers know no time limit
        self._endpoints: Set[Tuple[str, int]] = set()  # connections to these are ended
        self._sweeps = RecurringJob(
            self._enders, lambda: SWEEP, self._sweep, self._on_sweep, lambda: bool(self._endpoints)
        )

    def look(self, now: float) -> None:
        """See which masters were lost or are back. Called after each of their news: two may come in one pass."""
        if not self._active:
            return
        looks, endings = self._losses.update(self._online(), now)
        for look in looks:
            self._sweeps.due = now
            for _name, uri in look.nodes:
                self._askers.submit(partial(_connections_with, look, uri), partial(self._on_connections, look.master))
        for disconnection in endings:
            self._enders.submit(partial(_end, disconnection), self._report)
        self._endpoints = self._losses.endpoints()

    def tick(self, now: float) -> Optional[float]:
        """End the connections to lost masters when that is due; the time of the next call."""
        return self._sweeps.tick(now)

    def note_registrations(self, held: Mapping[Registration, str], view: View, claims: Claims, now: float) -> None:
        """Note the registrations, and look up the addresses of their hosts: after a loss these may be unknown."""
        if self._active:
            self._losses.take_registrations(held, view, claims)
            for host in self._losses.to_resolve(now):
                self._resolve(host)
            self._endpoints = self._losses.endpoints()

    def _resolve(self, host: str) -> None:
        def on_addresses(addresses: Optional[FrozenSet[str]], _problem: Optional[Exception]) -> None:
            if addresses:
                self._losses.take_addresses(host, addresses, monotonic())
                self._endpoints = self._losses.endpoints()

        self._resolvers.submit(lambda: connections.addresses_of(host), on_addresses)

    def _on_connections(self, master: str, noted: Optional[Set[Connection]], _problem: Optional[Exception]) -> None:
        self._losses.take_connections(master, noted or set())

    def _sweep(self) -> List[Pair]:
        """End all connections of this computer with nodes of lost masters."""
        endpoints = self._endpoints
        return end(lambda item: item.remote in endpoints)

    def _on_sweep(self, ended: Optional[List[Pair]], problem: Optional[Exception]) -> None:
        if ended:  # the roscore may have a queue of calls to them
            self._sweeps.due = monotonic() + SWEEP_AGAIN
        self._report(ended, problem)

    def _report(self, ended: Optional[List[Pair]], problem: Optional[Exception]) -> None:
        for (_address, port), remote in (ended or [])[:LINES]:
            program.LOG.info("the connection from port %d to %s:%d is ended", port, *remote)
        if problem is not None:
            self._limited.say("warning", "end", f"connections with lost robots cannot be ended: {problem}")


def _possible() -> bool:
    try:
        problem = ask([]).problem
    except OSError as error:
        problem = f"multimaster-connections.service does not answer: {error}"
    if problem:
        program.LOG.info("connections with lost robots are left to TCP: %s", problem)
    return not problem


def _connections_with(look: Look, node_uri: str) -> Set[Connection]:
    """The connections of an own node with the nodes of a master."""
    answer = Rpc(node_uri, QUESTION_TIMEOUT, NODE).call("getBusInfo", "/rosfleet")
    return connections_of(answer[2] if isinstance(answer, list) and len(answer) == 3 else [], look.others)


def _end(disconnection: Disconnection) -> List[Pair]:
    return end(lambda item: disconnection.wants(item.local[1], item.remote, item.silent))
