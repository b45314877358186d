# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The nodes that are still there after a restart of the roscore: each is asked for its registrations.

A node whose port is closed is dead. Silence proves nothing: a cable may be out, or a debugger may hold the process. So a silent
node stays, and is asked again as long as it is registered. By now another process may have the port. So the topics of the
answer are compared with those that the node had registered.

After a boot of the computer a node of another computer counts only from its first answer on.
"""

import logging
import xmlrpc.client
from contextlib import closing, suppress
from functools import partial
from typing import TYPE_CHECKING, Callable, Dict, List, Optional, Sequence, Set

from ..edge.clock import monotonic
from ..edge.loop import Loop, Workers
from ..edge.rpc_client import Rpc
from ..protocol.messages import NodeKey
from ..protocol.xml_rpc import NODE
from .core.registry import Record, Registry, node_of
from .tcpros import provider

if TYPE_CHECKING:  # it needs rosmaster
    from .master import MasterMethods

_log = logging.getLogger("rosfleet.survivors")

THREADS = 16
TIMEOUT = 2.0  # seconds of a question
AGAIN, LATEST = 1.0, 30.0  # seconds until a silent node is asked again, doubled up to
CALLER = "/master"
LINES = 100  # of the log, about nodes one by one


Judge = Callable[[Optional[List[Record]], Optional[Exception]], bool]  # of an answer of `ask`, or of its problem


def group_by_node(registry: Registry) -> Dict[NodeKey, List[Record]]:
    """The publishers, subscribers and services of each node, by name and URI."""
    nodes: Dict[NodeKey, List[Record]] = {node: [] for node in registry.values("node").items()}
    for record in registry.facts.values():
        if record.kind in ("service", *_LISTS) and node_of(record) in nodes:
            nodes[node_of(record)].append(record)
    return nodes


def ask(name: str, uri: str, records: Sequence[Record]) -> Optional[List[Record]]:
    """Ask a node for its registrations: those of its records that are not true any more; None if it is gone.

    Raises OSError if it says nothing.
    """
    try:
        has = _list_topics(uri)
    except (ConnectionRefusedError, ValueError, xmlrpc.client.Fault):  # no program has the port, or another one
        return None
    used = [record for record in records if record.kind in _LISTS]
    if used and len(has) == len(_LISTS) and not any(record.name in has[record.kind] for record in used):
        return None
    ended = [record for record in used if record.kind in has and record.name not in has[record.kind]]
    services = [record for record in records if record.kind == "service"]
    return ended + [record for record in services if not _provides(name, record.name, record.place)]


def _list_topics(uri: str) -> Dict[str, Set[str]]:
    """Kind -> topics, as far as the node lists them. Raises OSError, ValueError or Fault."""
    has: Dict[str, Set[str]] = {}
    with closing(Rpc(uri, TIMEOUT, NODE)) as rpc:
        rpc.call("getPid", CALLER)
        for kind, method in _LISTS.items():
            with suppress(xmlrpc.client.Fault, TypeError, ValueError, IndexError):  # it does not list these
                answer = rpc.call(method, CALLER)
                if answer[0] == 1:
                    has[kind] = {topic for topic, _type in answer[2]}
    return has


_LISTS = {"publisher": "getPublications", "subscriber": "getSubscriptions"}


def _provides(name: str, service: str, uri: str) -> bool:
    """True if a living node still provides a service, or if that cannot be found out.

    A closed port proves nothing: rospy and roscpp keep it open when a service ends, so a filter or a wrong name is the cause.
    """
    try:
        return provider(uri, service, TIMEOUT) == name
    except (OSError, ValueError) as problem:
        _log.debug("%s at %s: %s", service, uri, problem)
        return True


class Survivors:
    """Asks the nodes of an earlier life until each has answered or is gone."""

    def __init__(self, workers: Workers, roscore: "MasterMethods") -> None:
        """Ask in these workers, and change this roscore."""
        self._workers, self._roscore = workers, roscore
        self._silent: Set[NodeKey] = set()  # registered nodes without an answer yet
        self._warned: Set[NodeKey] = set()
        self._leaving: Set[NodeKey] = set()
        self._alive = self._gone = self._lines = 0

    @property
    def silent(self) -> int:
        """The number of registered nodes without an answer yet."""
        return len(self._silent)

    def begin(self, registry: Registry) -> None:
        """Ask registered nodes: each stays until it is known to have ended."""
        nodes = group_by_node(registry)
        self._silent = set(nodes)
        for node, records in nodes.items():
            self._ask(node, records, partial(self._judge, node))

    def wait_for(self, registry: Registry) -> None:
        """Ask nodes that are not registered: each is registered again when it answers."""
        for node, records in group_by_node(registry).items():
            self._ask(node, records, partial(self._welcome, node, registry))

    def look_after(self, name: str, uri: str) -> None:
        """Ask a node that has withdrawn everything, until it has ended or has something again."""
        node = (name, uri)
        if node not in self._leaving:
            self._leaving.add(node)
            self._ask(node, [], partial(self._bury, node), AGAIN)

    def _ask(
        self, node: NodeKey, records: Sequence[Record], judge: Judge, after: float = 0.0, pause: float = AGAIN
    ) -> None:
        """Ask a node after so many seconds, and again while `judge` wants that."""

        def on_answer(ended: Optional[List[Record]], problem: Optional[Exception]) -> None:
            if problem is not None:
                _log.debug("%s at %s: %s", *node, problem)
            if judge(ended, problem):
                self._ask(node, records, judge, pause, min(2 * pause, LATEST))

        self._workers.submit_later(after, partial(ask, *node, records), on_answer)

    def _judge(self, node: NodeKey, ended: Optional[List[Record]], problem: Optional[Exception]) -> bool:
        """Act on the answer of a registered node. True if the node is to be asked again."""
        name, uri = node
        if problem is not None and self._roscore.has(name, uri):
            if node not in self._warned:
                self._warned.add(node)
                self._say(_log.warning, "%s at %s does not answer: it stays registered, and is asked again", name, uri)
            return True
        self._silent.discard(node)
        if ended is not None:
            self._alive += 1
            for record in ended:
                if self._roscore.end_registration(record):
                    _log.info("%s does not have the %s %s any more", name, record.kind, record.name)
        elif problem is None:
            self._gone += 1
            self._say(_log.info, "%s at %s has ended meanwhile", name, uri)
            self._roscore.end_node(name, uri)
        if not self._silent:
            _log.info("of the nodes from before, %d are still there and %d have ended", self._alive, self._gone)
        return False

    def _say(self, log: Callable[..., None], text: str, *names: str) -> None:
        """Log a line about a node; there may be a hundred thousand of them."""
        self._lines += 1
        if self._lines <= LINES:
            log(text, *names)
        elif self._lines == LINES + 1:
            _log.info("the fate of further nodes is not logged one by one")

    def _bury(self, node: NodeKey, ended: Optional[List[Record]], problem: Optional[Exception]) -> bool:
        """End the rest of a node if it is dead. True if the node is to be asked again."""
        gone = ended is None and problem is None
        if not gone and self._roscore.has(*node) and self._roscore.has_ended(node[0]):
            return True
        self._leaving.discard(node)
        if gone:
            self._roscore.bury(*node)
        return False

    def _welcome(
        self, node: NodeKey, registry: Registry, ended: Optional[List[Record]], problem: Optional[Exception]
    ) -> bool:
        """Register a node again if it lives. True if the node is to be asked again."""
        if ended is not None:
            _log.info("%s at %s is still there: it is registered again", *node)
            back = registry.exclude(lambda *other: other != node)
            for record in ended:
                back.apply(record._replace(there=False))
            self._roscore.readmit(back)
        return problem is not None


def find_alive(registry: Registry, seconds: float) -> Set[NodeKey]:
    """The nodes of a registry, by name and URI, that answer within this time."""
    loop, nodes, alive = Loop(), group_by_node(registry), set()
    left, end = set(nodes), monotonic() + seconds

    def on_answer(node: NodeKey, ended: Optional[List[Record]], _problem: Optional[Exception]) -> None:
        left.discard(node)
        if ended is not None:
            alive.add(node)

    def tick(now: float) -> float:
        if not left or now >= end:
            loop.stop()
        return end

    workers = Workers(loop, min(THREADS, len(nodes)), len(nodes) + 1)
    for node, records in nodes.items():
        workers.submit(partial(ask, *node, records), partial(on_answer, node))
    loop.run(tick)
    return alive
