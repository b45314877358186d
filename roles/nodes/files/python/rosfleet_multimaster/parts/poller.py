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
LOOKUPS, REST = 100, 4  # known nodes (and services) looked up again, in every fourth poll
POSTPONE = 5.0  # seconds that a state waits for get_sync_info of another implementation of master_sync,
GIVE_UP = 60.0  # and after that it is asked again only now and then
RECORD = (("getParam", imports.IMPORTS), ("getParam", "/do_not_sync"))

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
        self._graph: Optional[Graph] = None
        self._last = Last()  # the answer that this graph is of
        self._node_uris: Dict[str, str] = {}
        self._service_uris: Dict[str, str] = {}
        self._origins: Dict[Tuple[str, str], str] = {}
        self._record: Dict[str, Any] = {}
        self._count = 0
        self._silent: Dict[Tuple[str, str], float] = {}  # providers of get_sync_info that do not answer, since when
        self.do_not_sync: Any = None

    def poll(self) -> State:
        """The state now. Raises OSError and the like where the roscore does not answer, program.Fatal where it is another."""
        last, self._last = self._last, Last()  # it counts again when all of this is done
        graph = self._read(last)
        changed = graph != self._graph
        self._look_up(graph, changed)
        if changed and self._foreign(graph):
            if self._stamps.last is None:
                raise OSError("it is not known yet what is from other masters")
            return self._stamps.last
        self._graph, self._last = graph, last
        nodes = set(self._node_uris.items())
        self._origins = {key: origin for key, origin in self._origins.items() if key in nodes}
        state = build(self._uri, self._name, graph, self._node_uris, self._service_uris, self._origins)
        return self._stamps.of(state, wall_clock())

    def _read(self, last: Last) -> Graph:
        """The graph now. An answer that is the last one again, as most are, is that graph again."""
        service = self._identity.service
        calls = (*self._identity.calls(), ("getTopicTypes",), ("getSystemState",))
        answers = self._roscore.ask(*calls, last=last)
        if not answers and self._graph is not None:
            return self._graph
        pid, own, types, system = answers
        self._identity.check(service, pid, own)
        if types is None or system is None:
            raise OSError(f"{self._roscore.rpc.uri} does not tell its state")
        return graph_of(system, types)

    def tells(self, method: str) -> bool:
        """True where the roscore has this method. Raises as `poll` where it does not answer."""
        return self._roscore.has(method)

    def _look_up(self, graph: Graph, changed: bool) -> None:
        """Learn the URIs of what is new, and some of the others again: a node may come back under its old name."""
        nodes = _some(graph.nodes(), self._node_uris, self._count)
        services = _some(graph.services, self._service_uris, self._count)
        self._count += 1
        asked = [("lookupNode", node) for node in nodes] + [("lookupService", service) for service in services]
        record = changed or self._count % 10 == 0
        answers = self._roscore.ask(*asked, *(RECORD if record else ()))
        moved = _learn(self._node_uris, nodes, answers) | _learn(self._service_uris, services, answers[len(nodes) :])
        if record:
            text, self.do_not_sync = answers[-2:]
        elif moved:
            (text,) = self._roscore.ask(("getParam", imports.IMPORTS))
        if record or moved:
            self._record = imports.read(text)
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


def _some(names: Any, known: Dict[str, str], count: int) -> List[str]:
    """The names that are not known, and in turn some that are; forgets what is not there any more."""
    for name in known.keys() - set(names):
        del known[name]
    new, ordered = sorted(set(names) - known.keys()), sorted(known)
    if count % REST:
        return new
    at = count // REST * LOOKUPS % max(len(ordered), 1)
    return new + ordered[at : at + LOOKUPS]


def _learn(table: Dict[str, str], names: List[str], uris: List[Any]) -> bool:
    changed = False
    for name, uri in zip(names, uris):
        if isinstance(uri, str) and table.get(name) != uri:
            table[name], changed = uri, True
    return changed
