# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The nodes that are still there after a restart of the roscore: each is asked what it has.

A node whose port is closed is dead. Silence proves nothing: a cable may be out, or a debugger may hold the process. So a silent
node stays, and is asked again as long as it is registered. By now another process may have the port. So the topics of the
answer are compared with those that the node had registered.

After a boot of the computer a node of another computer counts only from its first answer on.
"""

import enum
import logging
import xmlrpc.client
from contextlib import closing
from functools import partial
from typing import TYPE_CHECKING, Callable, Dict, List, NamedTuple, Optional, Set

from ..edge.clock import monotonic
from ..edge.loop import Loop, Workers, run_later
from ..edge.rpc_client import Rpc
from ..protocol.xml_rpc import NODE
from .core.registry import NodeKey, Record, Registry
from .tcpros import provider

if TYPE_CHECKING:  # it needs rosmaster
    from .master import Master

_log = logging.getLogger("rosfleet.survivors")

THREADS = 16
TIMEOUT = 2.0  # seconds of a question
AGAIN, LATEST = 1.0, 30.0  # seconds until a silent node is asked again, doubled up to
CALLER = "/master"
LINES = 100  # of the log, about nodes one by one


class State(enum.Enum):
    """The state of a node."""

    ALIVE = "alive"
    GONE = "gone"
    SILENT = "silent"


class Answer(NamedTuple):
    """The answer of a node."""

    state: State
    ended: List[Record] = []  # registrations that it does not have any more


class Endpoints(NamedTuple):
    """The registrations of a node."""

    topics: Dict[str, Set[str]]  # "publisher" and "subscriber" -> topics
    services: Dict[str, str]  # service -> its URI


def collect_endpoints(registry: Registry) -> Dict[NodeKey, Endpoints]:
    """The registrations of each node, by name and URI."""
    nodes = {node: Endpoints({"publisher": set(), "subscriber": set()}, {}) for node in registry.nodes.items()}
    for kind, table in (("publisher", registry.publishers), ("subscriber", registry.subscribers)):
        for topic, users in table.items():
            for node in users:
                if node in nodes:
                    nodes[node].topics[kind].add(topic)
    for name, service in registry.services.items():
        if (service.node, service.node_uri) in nodes:
            nodes[service.node, service.node_uri].services[name] = service.uri
    return nodes


def ask(name: str, uri: str, endpoints: Endpoints) -> Answer:
    """Ask a node what it has."""
    try:
        with closing(Rpc(uri, TIMEOUT, NODE)) as rpc:
            rpc.call("getPid", CALLER)
            has = {kind: _topics(rpc, method) for kind, method in _LISTS.items()}
    except ConnectionRefusedError:
        return Answer(State.GONE)
    except OSError as problem:
        _log.debug("%s at %s: %s", name, uri, problem)
        return Answer(State.SILENT)
    except (ValueError, xmlrpc.client.Fault):
        return Answer(State.GONE)  # another program has the port
    if None not in has.values() and any(endpoints.topics.values()):
        if not any(endpoints.topics[kind] & (has[kind] or set()) for kind in has):
            return Answer(State.GONE)
    ended = [
        [kind, topic, name, uri]
        for kind, topics in has.items()
        if topics is not None
        for topic in sorted(endpoints.topics[kind] - topics)
    ]
    ended += [
        ["service", service, name, at, uri]
        for service, at in endpoints.services.items()
        if not _provides(name, service, at)
    ]
    return Answer(State.ALIVE, ended)


_LISTS = {"publisher": "getPublications", "subscriber": "getSubscriptions"}


def _topics(rpc: Rpc, method: str) -> Optional[Set[str]]:
    """The topics of a node; None where it does not tell them."""
    try:
        answer = rpc.call(method, CALLER)
        return {topic for topic, _type in answer[2]} if answer[0] == 1 else None
    except (xmlrpc.client.Fault, TypeError, ValueError, IndexError):
        return None


def _provides(name: str, service: str, uri: str) -> bool:
    """True where a living node still provides a service, or where that cannot be found out.

    A closed port proves nothing: rospy and roscpp keep it open when a service ends, so a filter or a wrong name is the cause.
    """
    try:
        return provider(uri, service, TIMEOUT) == name
    except (OSError, ValueError) as problem:
        _log.debug("%s at %s: %s", service, uri, problem)
        return True


class Survivors:
    """Asks the nodes of an earlier life until each has answered or is gone."""

    def __init__(self, workers: Workers, roscore: "Master") -> None:
        """Ask in these workers, and change this roscore."""
        self._workers, self._roscore = workers, roscore
        self._silent: Set[NodeKey] = set()  # registered nodes that have not answered yet
        self._warned: Set[NodeKey] = set()
        self._leaving: Set[NodeKey] = set()
        self._alive = self._gone = self._lines = 0

    @property
    def silent(self) -> int:
        """The number of registered nodes that have not answered yet."""
        return len(self._silent)

    def begin(self, registry: Registry) -> None:
        """Ask registered nodes: each stays until it is known to have ended."""
        self._silent = set(registry.nodes.items())
        for node, endpoints in collect_endpoints(registry).items():
            self._ask(node, endpoints, partial(self._judge, node))

    def wait_for(self, registry: Registry) -> None:
        """Ask nodes that are not registered: each is registered again when it answers."""
        for node, endpoints in collect_endpoints(registry).items():
            self._ask(node, endpoints, partial(self._welcome, node, registry))

    def look_after(self, name: str, uri: str) -> None:
        """Ask a node that has withdrawn everything, until it has ended or has something again."""
        node = (name, uri)
        if node not in self._leaving:
            self._leaving.add(node)
            run_later(AGAIN, partial(self._ask, node, Endpoints({}, {}), partial(self._bury, node)))

    def _ask(self, node: NodeKey, endpoints: Endpoints, judge: Callable[[Answer], bool], pause: float = AGAIN) -> None:
        def on_answer(answer: Optional[Answer], _problem: Optional[Exception]) -> None:
            if judge(Answer(State.SILENT) if answer is None else answer):
                run_later(pause, partial(self._ask, node, endpoints, judge, min(2 * pause, LATEST)))

        self._workers.submit(partial(ask, *node, endpoints), on_answer)

    def _judge(self, node: NodeKey, answer: Answer) -> bool:
        """Act on the answer of a registered node. True where the node is to be asked again."""
        name, uri = node
        if answer.state is State.SILENT and self._roscore.has(name, uri):
            if node not in self._warned:
                self._warned.add(node)
                self._say(_log.warning, "%s at %s does not answer: it stays registered, and is asked again", name, uri)
            return True
        self._silent.discard(node)
        if answer.state is State.GONE:
            self._gone += 1
            self._say(_log.info, "%s at %s has ended meanwhile", name, uri)
            self._roscore.end_node(name, uri)
        elif answer.state is State.ALIVE:
            self._alive += 1
            for record in answer.ended:
                if self._roscore.end_registration(record):
                    _log.info("%s does not have the %s %s any more", name, record[0], record[1])
        if not self._silent:
            _log.info("of the nodes from before, %d are still there and %d have ended", self._alive, self._gone)
        return False

    def _say(self, log: Callable[..., None], text: str, *names: str) -> None:
        """Log a line about a node; there may be a hundred thousand of them."""
        self._lines += 1
        if self._lines <= LINES:
            log(text, *names)
        elif self._lines == LINES + 1:
            _log.info("what became of further nodes is not logged one by one")

    def _bury(self, node: NodeKey, answer: Answer) -> bool:
        """End the rest of a node if it is dead. True where the node is to be asked again."""
        if answer.state is not State.GONE and self._roscore.has(*node) and self._roscore.has_ended(node[0]):
            return True
        self._leaving.discard(node)
        if answer.state is State.GONE:
            self._roscore.bury(*node)
        return False

    def _welcome(self, node: NodeKey, registry: Registry, answer: Answer) -> bool:
        """Register a node again if it lives. True where the node is to be asked again."""
        if answer.state is State.ALIVE:
            _log.info("%s at %s is still there: it is registered again", *node)
            back = registry.exclude(lambda *other: other != node)
            for record in answer.ended:
                back.apply([*record, False])
            self._roscore.readmit(back)
        return answer.state is State.SILENT


def find_alive(registry: Registry, seconds: float) -> Set[NodeKey]:
    """The nodes of a registry, by name and URI, that answer within this time."""
    loop, nodes, alive = Loop(), collect_endpoints(registry), set()
    left, end = set(nodes), monotonic() + seconds

    def on_answer(node: NodeKey, answer: Optional[Answer], _problem: Optional[Exception]) -> None:
        left.discard(node)
        if answer is not None and answer.state is State.ALIVE:
            alive.add(node)

    def tick(now: float) -> float:
        if not left or now >= end:
            loop.stop()
        return end

    workers = Workers(loop, min(THREADS, len(nodes)), len(nodes) + 1)
    for node, endpoints in nodes.items():
        workers.submit(partial(ask, *node, endpoints), partial(on_answer, node))
    loop.run(tick)
    return alive
