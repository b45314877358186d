# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Finds the discovery node of the own roscore by its topic and service, and asks it for its list of masters."""

from typing import Callable, List, NamedTuple, Optional, Sequence, Set, Tuple

from ..edge.clock import monotonic
from ..edge.lifeline import Lifeline, Socket, lifeline
from ..edge.loop import Loop, RecurringJob, Workers
from ..edge.process import program
from ..edge.process.systemd import notify
from ..edge.roscore import RoscoreGraph
from ..protocol.imports import Claims
from ..protocol.messages import AnnouncedMaster, View

CHANGES_TYPE = "MasterState"  # the end of the type of discovery's topic
LIST_MASTERS = "list_masters"  # the end of the name of its service
FIND = 30.0  # seconds between two looks for the discovery node, once it is known
LIST_FIRST, LIST = 0.5, 10.0  # seconds between two looks at list_masters: until the first answer, and then


class FindResult(NamedTuple):
    """The discovery node of the own roscore; "" for unknown parts."""

    topic: str = ""
    service: str = ""
    uri: str = ""
    line: Optional[Socket] = None


class Finder:
    """Looks for the discovery node, and lists its masters regularly."""

    def __init__(
        self,
        loop: Loop,
        graph: RoscoreGraph,
        roscore_calls: Workers,
        limited: program.LimitedLog,
        claims: Callable[[], Claims],
        list_masters: Callable[[str], List[AnnouncedMaster]],
        subscribe: Callable[[str], None],
        on_list: Callable[[List[AnnouncedMaster], bool, float], None],
    ) -> None:
        """`subscribe(topic)` and `on_list(masters, first, asked at)` are called in the loop; `list_masters(service)` in a worker."""
        self.listed_once = False
        self._graph, self._limited, self._claims = graph, limited, claims
        self._subscribe, self._on_list = subscribe, on_list
        self._service = ""
        self._line = Lifeline(loop, self._on_end)
        self._finds = RecurringJob(
            roscore_calls, lambda: FIND if self._service else LIST_FIRST, self._find, self._on_result
        )
        self._lists = RecurringJob(
            Workers(loop, 2),
            lambda: LIST if self.listed_once else LIST_FIRST,
            lambda: (monotonic(), list_masters(self._service)),
            self._on_masters,
            lambda: bool(self._service),
        )

    def tick(self, now: float) -> List[Optional[float]]:
        """Do all that is due; the times of the next calls."""
        return [self._finds.tick(now), self._lists.tick(now)]

    def _on_end(self) -> None:
        """Look for the next discovery node: this one has ended, and is not asked any more."""
        self._service, self._finds.due = "", monotonic()

    def _find(self) -> FindResult:
        """The discovery node of this roscore, if it is alive (a roscore knows dead ones, too). With a lifeline to a new one."""
        foreign = {node for node, _uri in self._claims()}
        view = self._graph.read(lambda view: (_discovery(view, foreign)[2], []))  # the URI of no service is needed
        topics, services, nodes = _discovery(view, foreign)
        uri = view.node_uris.get(nodes[0], "") if nodes else ""
        line = lifeline(uri) if uri != self._line.uri else None
        if not uri or (line is None and uri != self._line.uri):
            return FindResult()
        return FindResult("".join(topics[:1]), services[0], uri, line)

    def _on_result(self, result: Optional[FindResult], _problem: Optional[Exception]) -> None:
        if result is None:
            self._finds.due = monotonic() + LIST_FIRST
            return
        if result.topic:
            self._subscribe(result.topic)
        if result.line is not None:
            self._line.hold(result.uri, result.line)
        if result.service:
            self._lists.due = self._lists.due if result.service == self._service else 0.0
            self._service = result.service
        else:
            text = f"no master_discovery on the roscore at {self._graph.roscore.rpc.uri}: waiting for it"
            self._limited.say("warning", "discovery", text)
            if not self.listed_once:
                notify(f"STATUS={text}")

    def _on_masters(self, answer: Optional[Tuple[float, List[AnnouncedMaster]]], problem: Optional[Exception]) -> None:
        if answer is None:
            self._finds.due = monotonic() + LIST_FIRST
            self._service = ""
            self._limited.say("warning", "list", f"master_discovery does not list the masters: {problem}")
            return
        first, self.listed_once = not self.listed_once, True
        asked, masters = answer
        self._on_list(masters, first, asked)


def _discovery(view: View, foreign: Set[str]) -> Tuple[List[str], List[str], List[str]]:
    """Topics, services and nodes of this robot's discovery."""

    def is_own(nodes: Sequence[str]) -> bool:
        return not foreign.issuperset(nodes)

    topics = sorted(
        topic
        for topic, nodes in view.publishers.items()
        if view.types.get(topic, "").endswith(CHANGES_TYPE) and is_own(nodes)
    )
    services = sorted(name for name, nodes in view.services.items() if name.endswith(LIST_MASTERS) and is_own(nodes))
    providers = view.services[services[0]] if services else []
    return topics, services, [node for node in providers if node not in foreign]
