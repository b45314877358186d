# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The poller: reads the state of the own roscore, again and again."""

from typing import Any, Callable, Dict, List, Optional, Tuple

from ..core.differences import Stamps
from ..core.graph import Graph, State, build, graph_of
from ..edge.clock import monotonic, wall_clock
from ..edge.roscore import Roscore
from ..edge.rpc_client import Last
from . import imports, program
from .own_roscore import Identity

GET_SYNC_INFO = "get_sync_info"  # the end of the name of the service of master_sync, in each implementation
REST = 0.5  # seconds between two looks at what is no registration, where nothing changed: parameters, types,
LOOKUPS = 100  # and the URIs of so many known nodes (and services)
POSTPONE = 5.0  # seconds that a state waits for get_sync_info of another implementation of master_sync,
GIVE_UP = 60.0  # and after that it is asked again only now and then
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
        self._last = Last()  # and the digest of that answer
        self._graph: Optional[Graph] = None
        self._state: Optional[State] = None  # what was made of it
        self._node_uris: Dict[str, str] = {}
        self._service_uris: Dict[str, str] = {}
        self._origins: Dict[Tuple[str, str], str] = {}
        self._record: Dict[str, Any] = {}
        self._turn, self._rest_due = 0, 0.0
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
        self._state = self._stamps.of(state, wall_clock())
        return self._state

    def _read(self, last: Last) -> bool:
        """Read the registrations. False where the answer is the last one again, as most are: it is not even parsed."""
        service = self._identity.service
        answers = self._roscore.ask(*self._identity.calls(), ("getSystemState",), last=last)
        if not answers:
            return False
        pid, own, system = answers
        self._identity.check(service, pid, own)
        if system is None:
            raise OSError(f"{self._roscore.rpc.uri} does not tell its state")
        self._system = system
        return True

    def tells(self, method: str) -> bool:
        """True where the roscore has this method. Raises as `poll` where it does not answer."""
        return self._roscore.has(method)

    def _look_up(self, changed: bool) -> Graph:
        """The graph: types, and the URIs of what is new, and some of the others again: a node may come back under its old name."""
        if self._graph is not None and not changed and monotonic() < self._rest_due:
            return self._graph
        self._rest_due = monotonic() + REST
        graph = graph_of(self._system, [])
        nodes = _some(graph.nodes(), self._node_uris, self._turn)
        services = _some(graph.services, self._service_uris, self._turn)
        self._turn += 1
        asked = [("lookupNode", node) for node in nodes] + [("lookupService", service) for service in services]
        *uris, types, text, self.do_not_sync = self._roscore.ask(*asked, *REST_CALLS)
        if types is None:
            raise OSError(f"{self._roscore.rpc.uri} does not tell its types")
        _learn(self._node_uris, nodes, uris)
        _learn(self._service_uris, services, uris[len(nodes) :])
        self._record = imports.read(text)
        for master, imported in self._record.get("imports", {}).items():
            self._origins.update(dict.fromkeys(imported.items(), master))
        return graph_of(self._system, types)

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


def _some(names: Any, known: Dict[str, str], turn: int) -> List[str]:
    """The names that are not known, and in turn some that are; forgets what is not there any more."""
    for name in known.keys() - set(names):
        del known[name]
    new, ordered = sorted(set(names) - known.keys()), sorted(known)
    at = turn * LOOKUPS % max(len(ordered), 1)
    return new + ordered[at : at + LOOKUPS]


def _learn(table: Dict[str, str], names: List[str], uris: List[Any]) -> None:
    table.update((name, uri) for name, uri in zip(names, uris) if isinstance(uri, str))
