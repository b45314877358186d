# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The poller: reads the state of the own roscore, again and again."""

import math
from typing import Any, Callable, Dict, List, Optional, Tuple

from ..edge.clock import monotonic, wall_clock
from ..edge.local_roscore import Identity
from ..edge.process import program
from ..edge.roscore import Roscore
from ..edge.rpc_client import Last
from ..protocol import imports
from ..protocol.differences import Stamps
from ..protocol.graph import Graph, State, build, graph_of
from .core.pace import PollPace

GET_SYNC_INFO = "get_sync_info"  # the end of the name of the service of master_sync, in each implementation
REST = 0.5  # seconds at least between two looks at what is no registration, where nothing changed: parameters, types,
LOOKUPS = 100  # and the URIs of so many known nodes and services
POSTPONE = 5.0  # seconds that a state waits for get_sync_info of another implementation of master_sync,
GIVE_UP = 60.0  # and after that it is asked again only now and then
_NODE, _SERVICE = "lookupNode", "lookupService"
REST_CALLS = (("getTopicTypes",), ("getParam", imports.IMPORTS), ("getParam", "/do_not_sync"))

SyncInfo = Callable[[str], Dict[Tuple[str, str], str]]  # service -> (node, URI) -> URI of its master


class Poller:
    """Reads the state of the roscore."""

    def __init__(
        self,
        roscore: Roscore,
        uri: str,
        name: str,
        identity: Identity,
        sync_info: SyncInfo,
        stamps: Optional[Stamps] = None,
    ) -> None:
        """`uri` and `name` are those of the master. `sync_info(service)` asks another implementation; it may raise anything."""
        self._roscore, self._uri, self._name, self._identity = roscore, uri, name, identity
        self._sync_info, self._stamps = sync_info, stamps or Stamps()
        self._system: Any = None  # the registrations of the last poll, as the roscore told them,
        self._last = Last()  # and the digest of that answer,
        self._rest: Dict[int, Last] = {}  # and of those to the other questions, by the turn of the names in them
        self._graph: Optional[Graph] = None
        self._state: Optional[State] = None  # what was made of it
        self._node_uris: Dict[str, str] = {}
        self._service_uris: Dict[str, str] = {}
        self._origins: Dict[Tuple[str, str], str] = {}
        self._record: Dict[str, Any] = {}
        self._turn, self._rest_due, self._rest_pace = 0, 0.0, PollPace(REST)
        self._silent: Dict[Tuple[str, str], float] = {}  # providers of get_sync_info that do not answer, since when
        self.do_not_sync: Any = None

    def poll(self) -> State:
        """The state now. Raises OSError and the like where the roscore does not answer, program.Fatal where it is another."""
        last, self._last = self._last, Last()  # it counts again when all of this is done
        changed = self._read(last)
        graph = self._look_up(changed)
        if changed and self._foreign(graph):
            if self._stamps.last is None:
                raise OSError("it is not known yet what is from other masters")
            return self._stamps.last
        self._last = last
        if graph is self._graph and self._stamps.last is self._state and self._state is not None:
            return self._state
        self._graph = graph
        nodes = set(self._node_uris.items())
        self._origins = {key: origin for key, origin in self._origins.items() if key in nodes}
        state = build(self._uri, self._name, graph, self._node_uris, self._service_uris, self._origins)
        self._state = self._stamps.stamp(state, wall_clock())
        return self._state

    def _read(self, last: Last) -> bool:
        """Read the registrations. False where the answer is the last one again, as most are: it is not even parsed.

        Then it is the same roscore, too: it has the service of this node.
        """
        answers = self._roscore.ask(("getSystemState",), last=last)
        if not answers:
            return False
        (system,) = answers
        if system is None:
            raise OSError(f"{self._roscore.rpc.uri} does not tell its state")
        self._system = system
        return True

    def tells(self, method: str) -> bool:
        """True where the roscore has this method. Raises as `poll` where it does not answer."""
        return self._roscore.has(method)

    def _look_up(self, changed: bool) -> Graph:
        """The graph: types, and the URIs of what is new, and some of the others again: a node may come back under its old name."""
        began = monotonic()
        if self._graph is not None and not changed and began < self._rest_due:
            return self._graph
        kept, self._rest = ({} if changed else self._rest), {}  # they count again when all of this is done
        graph = graph_of(self._system, []) if changed or self._graph is None else self._graph
        turn, asked = self._names(graph)
        service = self._identity.service
        answers = self._roscore.ask(*self._identity.calls(), *asked, *REST_CALLS, last=kept.setdefault(turn, Last()))
        if answers:
            pid, own, *uris, types, text, self.do_not_sync = answers
            self._identity.check(service, pid, own)
            if types is None:
                raise OSError(f"{self._roscore.rpc.uri} does not tell its types")
            self._learn(asked, uris, text)
            graph = graph_of(self._system, types)
        self._rest = kept
        self._rest_due = monotonic() + self._rest_pace.pause(began, monotonic() - began)
        return graph

    def _names(self, graph: Graph) -> Tuple[int, List[Tuple[str, str]]]:
        """The questions for the URIs of what is new, and of some that are known, in turn; and the number of the turn."""
        wanted = (
            (_NODE, sorted(graph.nodes()), self._node_uris),
            (_SERVICE, sorted(graph.services), self._service_uris),
        )
        known: List[Tuple[str, str]] = []
        new: List[Tuple[str, str]] = []
        for method, names, table in wanted:
            for name in table.keys() - set(names):
                del table[name]
            for name in names:
                (known if name in table else new).append((method, name))
        self._turn = (self._turn + 1) % max(1, math.ceil(len(known) / LOOKUPS))
        return self._turn, new + known[self._turn * LOOKUPS :][:LOOKUPS]

    def _learn(self, asked: List[Tuple[str, str]], uris: List[Any], record: Any) -> None:
        """Take over the URIs, and what master_sync has written down."""
        for (method, name), uri in zip(asked, uris):
            if isinstance(uri, str):
                (self._node_uris if method == _NODE else self._service_uris)[name] = uri
        self._record = imports.read(record)
        for master, imported in self._record.get("imports", {}).items():
            self._origins.update(dict.fromkeys(imported.items(), master))

    def _foreign(self, graph: Graph) -> bool:
        """Ask other implementations of master_sync what they registered. True while one should answer, but does not yet."""
        ours = self._record.get("node")
        if self._node_uris.get(ours or "", "") != self._record.get("uri"):
            ours = None
        unsure = False
        for service, users in graph.services.items():
            provider = (users[0], self._node_uris.get(users[0], ""))
            if service.endswith(GET_SYNC_INFO) and users[0] != ours and provider not in self._origins:
                unsure = self._ask_foreign(service, provider) or unsure
        return unsure

    def _ask_foreign(self, service: str, provider: Tuple[str, str]) -> bool:
        """Ask one of them. True while it should answer, but does not yet; a silent one is asked again after GIVE_UP."""
        silent = monotonic() - self._silent.setdefault(provider, monotonic())
        if POSTPONE < silent < GIVE_UP:
            return False
        try:
            found = self._sync_info(service)
        except Exception as problem:  # rospy raises many
            program.LOG.debug("%s: %s", service, problem)
            if silent >= GIVE_UP:
                del self._silent[provider]
            return silent <= POSTPONE
        self._origins.update({key: master for key, master in found.items() if master != self._uri})
        del self._silent[provider]
        return False
