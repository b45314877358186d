# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The discovery node of the own roscore: found by its topic and service, and asked for its list of masters."""

from typing import Callable, List, NamedTuple, Optional, Set, Tuple

from ..edge.clock import monotonic
from ..edge.lifeline import Lifeline, Socket, lifeline
from ..edge.loop import Loop, RecurringJob, Workers
from ..edge.process import program
from ..edge.process.systemd import notify
from ..protocol.imports import Claims
from ..protocol.messages import Master
from .core.sync import View
from .own_graph import OwnGraph

CHANGES_TYPE = "MasterState"  # the topic of discovery is known by the end of its type,
LIST_MASTERS = "list_masters"  # and its service by the end of its name
FIND = 30.0  # seconds between two looks for the discovery node, once it was found
LIST_FIRST, LIST = 0.5, 10.0  # seconds between two looks at list_masters, until the first answer and then


class Found(NamedTuple):
    """The discovery node of the own roscore, as far as it was found."""

    topic: str
    service: str
    uri: str
    line: Optional[Socket]


class Finder:
    """Looks for the discovery node, and lists its masters regularly."""

    def __init__(
        self,
        loop: Loop,
        graph: OwnGraph,
        roscore_calls: Workers,
        limited: program.LimitedLog,
        claims: Callable[[], Claims],
        list_masters: Callable[[str], List[Master]],
        subscribe: Callable[[str], None],
        listed: Callable[[List[Master], bool, float], None],
    ) -> None:
        """`subscribe(topic)` and `listed(masters, first, asked at)` are called in the loop; `list_masters(service)` in a worker."""
        self.listed_once = False
        self._graph, self._limited, self._claims = graph, limited, claims
        self._subscribe, self._on_list = subscribe, listed
        self._service = ""
        self._line = Lifeline(loop, self._ended)
        self._finds = RecurringJob(
            roscore_calls, lambda: FIND if self._service else LIST_FIRST, self._find, self._found
        )
        self._lists = RecurringJob(
            Workers(loop, 2),
            lambda: LIST if self.listed_once else LIST_FIRST,
            lambda: (monotonic(), list_masters(self._service)),
            self._listed,
            lambda: bool(self._service),
        )

    def tick(self, now: float) -> List[Optional[float]]:
        """Do what is due; the times of the next calls."""
        return [self._finds.tick(now), self._lists.tick(now)]

    def _ended(self) -> None:
        """The discovery node has ended, and the next one may be there soon. Nothing is asked of a dead one."""
        self._service, self._finds.due = "", monotonic()

    def _find(self) -> Found:
        """The discovery node of this roscore, if it is alive: a roscore also knows dead ones. With a lifeline that is new."""
        foreign = {node for node, _uri in self._claims()}
        view = self._graph.read(lambda view: _discovery(view, foreign)[2:])
        topics, services, nodes, _names = _discovery(view, foreign)
        uri = view.node_uris.get(nodes[0], "") if nodes else ""
        line = lifeline(uri) if uri != self._line.uri else None
        if not uri or (line is None and uri != self._line.uri):
            return Found("", "", "", None)
        return Found("".join(topics[:1]), services[0], uri, line)

    def _found(self, found: Optional[Found], problem: Optional[Exception]) -> None:
        topic, service = (found.topic, found.service) if found is not None else ("", "")
        if topic:
            self._subscribe(topic)
        if problem is not None:
            self._finds.due = monotonic() + LIST_FIRST
        if found is not None and found.line is not None:
            self._line.hold(found.uri, found.line)
        if service and service != self._service:
            self._lists.due = 0.0
        if service:
            self._service = service
        elif problem is None:
            text = f"no master_discovery on the roscore at {self._graph.roscore.rpc.uri}: waiting for it"
            self._limited.say("warning", "discovery", text)
            if not self.listed_once:
                notify(f"STATUS={text}")

    def _listed(self, answer: Optional[Tuple[float, List[Master]]], problem: Optional[Exception]) -> None:
        if answer is None:
            self._finds.due = monotonic() + LIST_FIRST
            self._service = ""
            self._limited.say("warning", "list", f"master_discovery does not list the masters: {problem}")
            return
        first, self.listed_once = not self.listed_once, True
        asked, masters = answer
        self._on_list(masters, first, asked)


def _discovery(view: View, foreign: Set[str]) -> Tuple[List[str], List[str], List[str], List[str]]:
    """Topics, services and nodes of discovery that are not another robot's; and no service whose URI is needed."""
    own = {name: [node for node in nodes if node not in foreign] for name, nodes in view.publishers.items()}
    kind = CHANGES_TYPE
    topics = sorted(topic for topic, nodes in own.items() if nodes and view.types.get(topic, "").endswith(kind))
    services = {name: [node for node in nodes if node not in foreign] for name, nodes in view.services.items()}
    found = sorted(name for name, nodes in services.items() if nodes and name.endswith(LIST_MASTERS))
    return topics, found, services[found[0]] if found else [], []
