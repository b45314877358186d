# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Which nodes are still there after the roscore has ended and come back: each is asked what it has.

Who refuses the connection is dead. Silence proves nothing: the cable of another computer may be out, or a debugger hold the
process. So who does not answer stays, and is asked again for as long as it is registered. A port may be another process's by
now, so what the node says that it publishes and subscribes to is compared with what it had registered.

After a boot of the computer it is the other way round: a node of another computer counts from its first answer on.
"""

import enum
import logging
import xmlrpc.client
from functools import partial
from typing import Callable, Dict, List, NamedTuple, Optional, Protocol, Set

from ..edge.clock import monotonic
from ..edge.loop import Loop, Workers, run_later
from ..edge.rpc_client import Rpc
from ..protocol.xml_rpc import NODE
from .core.registry import NodeKey, Record, Registry
from .tcpros import provider

_log = logging.getLogger("rosfleet.survivors")

THREADS = 16
TIMEOUT = 2.0  # seconds of a question
AGAIN, LATEST = 1.0, 30.0  # seconds until a silent node is asked again, doubled up to
CALLER = "/master"
LINES = 100  # of the log, about nodes one by one


class State(enum.Enum):
    """The fate of a node."""

    ALIVE = "alive"
    GONE = "gone"
    SILENT = "silent"


class Found(NamedTuple):
    """The answer of a node."""

    state: State
    ended: List[Record] = []  # registrations that it does not have any more


class Had(NamedTuple):
    """The registrations of a node."""

    topics: Dict[str, Set[str]]  # "publisher" and "subscriber" -> topics
    services: Dict[str, str]  # service -> its URI


def had(registry: Registry) -> Dict[NodeKey, Had]:
    """The registrations of each node, by name and URI."""
    found = {of: Had({"publisher": set(), "subscriber": set()}, {}) for of in registry.nodes.items()}
    for kind, table in (("publisher", registry.publishers), ("subscriber", registry.subscribers)):
        for topic, users in table.items():
            for of in users:
                if of in found:
                    found[of].topics[kind].add(topic)
    for service, held in registry.services.items():
        if (held.node, held.node_uri) in found:
            found[held.node, held.node_uri].services[service] = held.uri
    return found


def ask(name: str, uri: str, held: Had) -> Found:
    """The fate of a node."""
    try:
        rpc = Rpc(uri, TIMEOUT, NODE)
        try:
            rpc.call("getPid", CALLER)
            has = {kind: _topics(rpc, method) for kind, method in _LISTS.items()}
        finally:
            rpc.close()
    except ConnectionRefusedError:
        return Found(State.GONE)
    except OSError as problem:
        _log.debug("%s at %s: %s", name, uri, problem)
        return Found(State.SILENT)
    except (ValueError, xmlrpc.client.Fault):
        return Found(State.GONE)  # somebody else's port by now
    if None not in has.values() and any(held.topics.values()):
        if not any(held.topics[kind] & (has[kind] or set()) for kind in has):
            return Found(State.GONE)
    ended = [
        [kind, topic, name, uri]
        for kind, topics in has.items()
        if topics is not None
        for topic in sorted(held.topics[kind] - topics)
    ]
    ended += [
        ["service", service, name, at, uri] for service, at in held.services.items() if not _provides(name, service, at)
    ]
    return Found(State.ALIVE, ended)


_LISTS = {"publisher": "getPublications", "subscriber": "getSubscriptions"}


def _topics(rpc: Rpc, method: str) -> Optional[Set[str]]:
    """The topics of a node, None where it does not tell them."""
    try:
        answer = rpc.call(method, CALLER)
        return {topic for topic, _type in answer[2]} if answer[0] == 1 else None
    except (xmlrpc.client.Fault, TypeError, ValueError, IndexError):
        return None


def _provides(name: str, service: str, uri: str) -> bool:
    """True where a node that lives still provides a service; true where nobody can tell.

    A port that refuses says nothing: rospy and roscpp keep it open when a service ends, so there is a filter, or another name.
    """
    try:
        return provider(uri, service, TIMEOUT) == name
    except (OSError, ValueError) as problem:
        _log.debug("%s at %s: %s", service, uri, problem)
        return True


class Registrations(Protocol):
    """What a survey does to the roscore."""

    def has(self, name: str, uri: str) -> bool:
        """True while this node has the name."""

    def end_node(self, name: str, uri: str) -> None:
        """End a node that is dead."""

    def end_registration(self, record: Record) -> bool:
        """End what a node has no more. Whether it was there."""

    def come_back(self, registry: Registry) -> None:
        """Register nodes anew that live."""

    def has_ended(self, name: str) -> bool:
        """True where a node has withdrawn everything and is still known."""

    def bury(self, name: str, uri: str) -> None:
        """End what is left of such a node."""


class Survivors:
    """Asks the nodes of an earlier life, until each has answered or is gone."""

    def __init__(self, workers: Workers, roscore: Registrations) -> None:
        """Ask in these workers, and have it done to this roscore."""
        self._workers, self._roscore = workers, roscore
        self._left: Set[NodeKey] = set()  # registered nodes that have not answered yet
        self._warned: Set[NodeKey] = set()
        self._leaving: Set[NodeKey] = set()
        self._alive = self._gone = self._lines = 0

    @property
    def silent(self) -> int:
        """How many registered nodes have not answered yet."""
        return len(self._left)

    def begin(self, registry: Registry) -> None:
        """Ask nodes that are registered: each stays until it is known that it has ended."""
        self._left = set(registry.nodes.items())
        for of, held in had(registry).items():
            self._ask(of, held, partial(self._judge, of))

    def wait_for(self, registry: Registry) -> None:
        """Ask nodes that are not registered: each comes back when it answers."""
        for of, held in had(registry).items():
            self._ask(of, held, partial(self._welcome, of, registry))

    def look_after(self, name: str, uri: str) -> None:
        """Ask a node that has withdrawn everything, until it has ended or has something again."""
        of = (name, uri)
        if of not in self._leaving:
            self._leaving.add(of)
            run_later(AGAIN, partial(self._ask, of, Had({}, {}), partial(self._bury, of)))

    def _ask(self, of: NodeKey, held: Had, judge: Callable[[Found], bool], pause: float = AGAIN) -> None:
        def answered(found: Optional[Found], _problem: Optional[Exception]) -> None:
            if judge(Found(State.SILENT) if found is None else found):
                run_later(pause, partial(self._ask, of, held, judge, min(2 * pause, LATEST)))

        self._workers.submit(partial(ask, *of, held), answered)

    def _judge(self, of: NodeKey, found: Found) -> bool:
        """Do what the answer of a registered node says. True where it is to be asked again."""
        name, uri = of
        if found.state is State.SILENT and self._roscore.has(name, uri):
            if of not in self._warned:
                self._warned.add(of)
                self._say(_log.warning, "%s at %s does not answer: it stays registered, and is asked again", name, uri)
            return True
        self._left.discard(of)
        if found.state is State.GONE:
            self._gone += 1
            self._say(_log.info, "%s at %s has ended meanwhile", name, uri)
            self._roscore.end_node(name, uri)
        elif found.state is State.ALIVE:
            self._alive += 1
            for record in found.ended:
                if self._roscore.end_registration(record):
                    _log.info("%s does not have the %s %s any more", name, record[0], record[1])
        if not self._left:
            _log.info("of the nodes from before, %d are still there and %d have ended", self._alive, self._gone)
        return False

    def _say(self, log: Callable[..., None], text: str, *of: str) -> None:
        """Log what became of a node; there may be a hundred thousand of them."""
        self._lines += 1
        if self._lines <= LINES:
            log(text, *of)
        elif self._lines == LINES + 1:
            _log.info("what became of further nodes is not logged one by one")

    def _bury(self, of: NodeKey, found: Found) -> bool:
        """End what is left of a node that is dead. True where it is to be asked again."""
        if found.state is not State.GONE and self._roscore.has(*of) and self._roscore.has_ended(of[0]):
            return True
        self._leaving.discard(of)
        if found.state is State.GONE:
            self._roscore.bury(*of)
        return False

    def _welcome(self, of: NodeKey, registry: Registry, found: Found) -> bool:
        """Register a node again that lives. True where it is to be asked again."""
        if found.state is State.ALIVE:
            _log.info("%s at %s is still there: it is registered again", *of)
            back = registry.exclude(lambda *other: other != of)
            for record in found.ended:
                back.apply([*record, False])
            self._roscore.come_back(back)
        return found.state is State.SILENT


def alive_of(registry: Registry, seconds: float) -> Set[NodeKey]:
    """Those nodes of a registry, by name and URI, that answer within this time."""
    loop, nodes, alive = Loop(), had(registry), set()
    left, end = set(nodes), monotonic() + seconds

    def answered(of: NodeKey, found: Optional[Found], _problem: Optional[Exception]) -> None:
        left.discard(of)
        if found is not None and found.state is State.ALIVE:
            alive.add(of)

    def tick(now: float) -> float:
        if not left or now >= end:
            loop.stop()
        return end

    workers = Workers(loop, min(THREADS, len(nodes)), len(nodes) + 1)
    for of, held in nodes.items():
        workers.submit(partial(ask, *of, held), partial(answered, of))
    loop.run(tick)
    return alive
