# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Which nodes are still there after the roscore has ended and come back: each is asked what it has.

Who refuses the connection is dead. Who does not answer in time is asked again. A port may be another process's by now, so
what the node says that it publishes and subscribes to is compared with what it had registered.
"""

import enum
import logging
import xmlrpc.client
from functools import partial
from typing import Callable, Dict, List, NamedTuple, Optional, Set, Tuple

from ..core.registry import Record, Registry
from ..edge.clock import monotonic
from ..edge.loop import Loop, Workers, after
from ..edge.rpc_client import Rpc
from ..edge.tcpros import provider
from ..edge.xml_rpc import NODE

_log = logging.getLogger("rosfleet.survivors")

THREADS = 16
TIMEOUT = 2.0  # seconds of a question
AGAIN, LATEST = 1.0, 30.0  # seconds until a silent node is asked again, doubled up to
CALLER = "/master"


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


def had(registry: Registry) -> Dict[Tuple[str, str], Had]:
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
        ["service", service, name, at] for service, at in held.services.items() if not _provides(name, service, at)
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
    """True where a node still provides a service; true where nobody can tell."""
    try:
        return provider(uri, service, TIMEOUT) == name
    except ConnectionRefusedError:
        return False
    except (OSError, ValueError) as problem:
        _log.debug("%s at %s: %s", service, uri, problem)
        return True


class Survivors:
    """Asks the nodes of an earlier life, until each has answered or is gone."""

    def __init__(
        self,
        workers: Workers,
        end_node: Callable[[str, str], None],
        end_registration: Callable[[Record], bool],
    ) -> None:
        """Take the two functions that end what is not true any more."""
        self._workers, self._end_node, self._end_registration = workers, end_node, end_registration
        self._left: Set[Tuple[str, str]] = set()
        self._alive = self._gone = 0

    def begin(self, registry: Registry) -> None:
        """Ask all nodes of a registry."""
        nodes = had(registry)
        self._left = set(nodes)
        for (name, uri), held in nodes.items():
            self._ask(name, uri, held, AGAIN)

    def _ask(self, name: str, uri: str, held: Had, pause: float) -> None:
        self._workers.submit(partial(ask, name, uri, held), partial(self._answered, name, uri, held, pause))

    def _answered(
        self, name: str, uri: str, held: Had, pause: float, found: Optional[Found], problem: Optional[Exception]
    ) -> None:
        if found is None or found.state is State.SILENT:
            if pause == AGAIN:
                _log.warning("%s at %s does not answer: it is asked again (%s)", name, uri, problem or "no answer")
            after(pause, partial(self._ask, name, uri, held, min(2 * pause, LATEST)))
            return
        self._left.discard((name, uri))
        if found.state is State.GONE:
            self._gone += 1
            _log.info("%s at %s has ended meanwhile", name, uri)
            self._end_node(name, uri)
        else:
            self._alive += 1
            for record in found.ended:
                if self._end_registration(record):
                    _log.info("%s does not have the %s %s any more", name, record[0], record[1])
        if not self._left:
            _log.info("of the nodes from before, %d are still there and %d have ended", self._alive, self._gone)


def alive_of(registry: Registry, seconds: float) -> Set[Tuple[str, str]]:
    """Those nodes of a registry, by name and URI, that answer within this time."""
    loop, nodes, alive = Loop(), had(registry), set()
    left, end = set(nodes), monotonic() + seconds

    def answered(of: Tuple[str, str], found: Optional[Found], _problem: Optional[Exception]) -> None:
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
