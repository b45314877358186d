# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The poller reads the state of the own roscore, again and again."""

import math
from typing import Any, Callable, Dict, List, Optional, Tuple

from ..edge.clock import monotonic, wall_clock
from ..edge.local_roscore import Identity
from ..edge.process import program
from ..edge.roscore import Roscore
from ..edge.rpc_client import Last
from ..protocol import imports
from ..protocol.differences import Stamps
from ..protocol.graph import State, build, graph_of, users_of
from .core.pace import PollPace

GET_SYNC_INFO = "get_sync_info"  # the end of the name of the service of master_sync, in each implementation
REST = 0.5  # seconds at least between two looks at the rest (types, parameters, some URIs) while registrations are the same
LOOKUPS = 100  # URIs of known nodes and services in one look at the rest
POSTPONE = 5.0  # seconds that a state waits for get_sync_info of another implementation of master_sync
GIVE_UP = 60.0  # seconds from the first question to a silent one until it is asked again
_NODE, _SERVICE = "lookupNode", "lookupService"
REST_CALLS = (("getTopicTypes",), ("getParam", imports.IMPORTS), ("getParam", "/do_not_sync"))

SyncInfo = Callable[[str], Dict[Tuple[str, str], str]]  # service -> (node, URI) -> URI of its master


class Poller:
    """Reads the state of the roscore."""

    def __init__(self, roscore: Roscore, empty: State, identity: Identity, sync_info: SyncInfo, stamps: Stamps) -> None:
        """`empty`: the state of the master, without registrations.

        `sync_info(service)` asks another implementation; it may raise anything.
        """
        self.roscore, self._empty, self._identity = roscore, empty, identity
        self._sync_info, self._stamps = sync_info, stamps
        self._system: Any = None  # the registrations of the last poll, as the roscore sent them
        self._last = Last()  # the digest of that answer
        self._rest: Dict[int, Last] = {}  # turn -> the digest of the answer about the rest
        self._graph: Optional[State] = None
        self._state: Optional[State] = None  # made of the graph
        self._node_uris: Dict[str, str] = {}
        self._service_uris: Dict[str, str] = {}
        self._origins: Dict[Tuple[str, str], str] = {}
        self._record = imports.ImportRecord()
        self._turn, self._rest_due, self._rest_pace = 0, 0.0, PollPace(REST)
        self._silent: Dict[Tuple[str, str], float] = {}  # providers of get_sync_info that do not answer, since when
        self.do_not_sync: Any = None

    def poll(self) -> State:
        """The state now. Raises OSError and the like without an answer, program.Fatal if the roscore is a new one."""
        last, self._last = self._last, Last()  # kept only after a whole poll
        changed = self._read(last)
        graph = self._look_up(changed)
        if changed and self._ask_others(graph):
            if self._stamps.last is None:
                raise OSError("the registrations from other masters are not known yet")
            return self._stamps.last
        self._last = last
        if graph is self._graph and self._stamps.last is self._state and self._state is not None:
            return self._state
        self._graph = graph
        nodes = set(self._node_uris.items())
        self._origins = {key: origin for key, origin in self._origins.items() if key in nodes}
        state = build(graph, self._node_uris, self._service_uris, self._origins)
        self._state = self._stamps.stamp(state, wall_clock())
        return self._state

    def _read(self, last: Last) -> bool:
        """Read the registrations. False if the answer is the same as the last one: it is not parsed then.

        The roscore is then the same one, too, since it has the service of this node.
        """
        answers = self.roscore.ask(("getSystemState",), last=last)
        if not answers:
            return False
        (system,) = answers
        if system is None:
            raise OSError(f"{self.roscore.rpc.uri} does not report its state")
        self._system = system
        return True

    def _look_up(self, changed: bool) -> State:
        """The graph with types. The URIs of new names are asked, and of some others: a node may come back under its name."""
        began = monotonic()
        if self._graph is not None and not changed and began < self._rest_due:
            return self._graph
        digests, self._rest = ({} if changed else self._rest), {}  # kept only after a whole look
        graph = graph_of(self._empty, self._system, []) if changed or self._graph is None else self._graph
        turn, lookups = self._select_lookups(graph)
        service = self._identity.service
        last = digests.setdefault(turn, Last())
        answers = self.roscore.ask(*self._identity.calls(), *lookups, *REST_CALLS, last=last)
        if answers:
            pid, own, *uris, types, text, self.do_not_sync = answers
            self._identity.check(service, pid, own)
            if types is None:
                raise OSError(f"{self.roscore.rpc.uri} does not report its types")
            self._learn(lookups, uris, text)
            graph = graph_of(self._empty, self._system, types)
        self._rest = digests
        self._rest_due = monotonic() + self._rest_pace.pause(began, monotonic() - began)
        return graph

    def _select_lookups(self, graph: State) -> Tuple[int, List[Tuple[str, str]]]:
        """The number of this turn, and its questions for URIs: of all new names, and of some known ones."""
        known: List[Tuple[str, str]] = []
        new: List[Tuple[str, str]] = []
        for method, names, table in (
            (_NODE, sorted(users_of(graph.publishers, graph.subscribers, graph.services)), self._node_uris),
            (_SERVICE, sorted(graph.services), self._service_uris),
        ):
            for name in table.keys() - set(names):
                del table[name]
            for name in names:
                (known if name in table else new).append((method, name))
        self._turn = (self._turn + 1) % max(1, math.ceil(len(known) / LOOKUPS))
        return self._turn, new + known[self._turn * LOOKUPS :][:LOOKUPS]

    def _learn(self, lookups: List[Tuple[str, str]], uris: List[Any], record: Any) -> None:
        """Take over the URIs, and the record of master_sync."""
        for (method, name), uri in zip(lookups, uris):
            if isinstance(uri, str):
                (self._node_uris if method == _NODE else self._service_uris)[name] = uri
        self._record = imports.read(record)
        self._origins.update(self._record.claims)

    def _ask_others(self, graph: State) -> bool:
        """Ask other implementations of master_sync for their registrations. True while the answer of one is awaited."""
        record = self._record
        ours = record.node if self._node_uris.get(record.node, "") == record.uri else None
        unsure = False
        for service, users in graph.services.items():
            provider = (users[0], self._node_uris.get(users[0], ""))
            if service.endswith(GET_SYNC_INFO) and users[0] != ours and provider not in self._origins:
                unsure = self._ask_other(service, provider) or unsure
        return unsure

    def _ask_other(self, service: str, provider: Tuple[str, str]) -> bool:
        """Ask one of them. True while its answer is awaited; a silent one is asked again after GIVE_UP."""
        silent = monotonic() - self._silent.setdefault(provider, monotonic())
        if POSTPONE < silent < GIVE_UP:
            return False
        try:
            origins = self._sync_info(service)
        except Exception as problem:  # rospy raises many
            program.LOG.debug("%s: %s", service, problem)
            if silent >= GIVE_UP:
                del self._silent[provider]
            return silent <= POSTPONE
        self._origins.update({key: master for key, master in origins.items() if master != self._empty.uri})
        del self._silent[provider]
        return False
