# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The poller: reads the state of the own roscore, again and again, in a thread of its own."""

from typing import Any, Callable, Dict, List, Optional, Tuple

from ..core.graph import Graph, State, build, graph_of, stamped
from ..edge.clock import monotonic, wall_clock
from ..edge.loop import Ended, in_thread
from ..edge.roscore import Roscore
from . import imports, program
from .own_roscore import Identity

GET_SYNC_INFO = "get_sync_info"  # the end of the name of the service of master_sync, in each implementation
LOOKUPS, REST = 100, 4  # known nodes (and services) looked up again, in every fourth poll
POSTPONE = 5.0  # seconds that a state waits for get_sync_info of another implementation of master_sync,
GIVE_UP = 60.0  # and after that it is asked again only now and then
RETRY = 0.1  # seconds until a roscore that does not answer is asked again
SHARE, SLOWEST = 10, 5.0  # a poll takes at most one part in so many of the time, but there is one every so many seconds
RECORD = (("getParam", imports.IMPORTS), ("getParam", "/do_not_sync"))

SyncInfo = Callable[[str], Dict[Tuple[str, str], str]]  # service -> (node, URI) -> URI of its master


def poll_in_thread(
    poller: "Poller",
    period: float,
    ended: Ended,
    polled: Callable[[State], None],
    failed: Callable[[str, float], None],
    give_up: Callable[[str], None],
) -> None:
    """Poll every `period` seconds, until `ended`. The callbacks are called in the poller's thread.

    `failed(why, since)`: the roscore does not answer since that time. `give_up(why)`: it is another one.
    """

    def poll() -> None:
        failing: Optional[float] = None
        while not ended:
            started = monotonic()
            try:
                polled(poller.poll())
                failing = None
            except program.Fatal as problem:
                give_up(str(problem))
                return
            except Exception as problem:  # a roscore that does not answer, or answers nonsense
                if not isinstance(problem, program.FAILURES):
                    program.LOG.debug("the roscore's state cannot be read", exc_info=True)
                failing = started if failing is None else failing
                failed(str(problem) or type(problem).__name__, failing)
            took = monotonic() - started
            ended.wait(RETRY if failing is not None else max(period, min(took * SHARE, SLOWEST)) - took)

    in_thread("poll", poll)


class Poller:
    """Reads the state of the roscore."""

    def __init__(self, roscore: Roscore, uri: str, name: str, identity: Identity, sync_info: SyncInfo) -> None:
        """`uri` and `name` are those of the master. `sync_info(service)` asks another implementation; it may raise anything."""
        self._roscore, self._uri, self._name, self._identity = roscore, uri, name, identity
        self._sync_info = sync_info
        self._graph: Optional[Graph] = None
        self._node_uris: Dict[str, str] = {}
        self._service_uris: Dict[str, str] = {}
        self._origins: Dict[Tuple[str, str], str] = {}
        self._record: Dict[str, Any] = {}
        self._state: Optional[State] = None
        self._count = 0
        self._silent: Dict[Tuple[str, str], float] = {}  # providers of get_sync_info that do not answer, since when
        self.do_not_sync: Any = None

    def poll(self) -> State:
        """The state now. Raises OSError and the like where the roscore does not answer, program.Fatal where it is another."""
        service = self._identity.service
        pid, own, types, system = self._roscore.ask(*self._identity.calls(), ("getTopicTypes",), ("getSystemState",))
        self._identity.check(service, pid, own)
        if types is None or system is None:
            raise OSError(f"{self._roscore.rpc.uri} does not tell its state")
        graph = graph_of(system, types)
        changed = graph != self._graph
        self._look_up(graph, changed)
        if changed and self._foreign(graph):
            if self._state is None:
                raise OSError("it is not known yet what is from other masters")
            return self._state
        self._graph = graph
        nodes = set(self._node_uris.items())
        self._origins = {key: origin for key, origin in self._origins.items() if key in nodes}
        state = build(self._uri, self._name, graph, self._node_uris, self._service_uris, self._origins)
        self._state = stamped(state, self._state, wall_clock())
        return self._state

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
