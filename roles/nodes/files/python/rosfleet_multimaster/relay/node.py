# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The relay as a node of ROS: its names, its slave API (wiki.ros.org/ROS/Slave_API), and its registrations."""

import os
import threading
from functools import partial
from typing import Any, Callable, Dict, List, Optional, Tuple

from ..edge.addresses import find_own_host, local_hosts
from ..edge.clock import monotonic
from ..edge.loop import Workers
from ..edge.roscore import Roscore
from ..edge.rpc_server import Method, PerCaller, RefusedCall
from .feed import BusLink

WITHDRAWAL = 3.0  # seconds that the roscore has for it, and for the call before it
RETRY = 1.0  # seconds until a registration that was refused is tried again
PUBLISHER, SUBSCRIBER, PROVIDER = "Publisher", "Subscriber", "Service"

Key = Tuple[str, str]  # PUBLISHER, SUBSCRIBER or PROVIDER, and a topic or service


class SlaveApi:
    """The methods that others call at the node. They are called in threads of the server."""

    def __init__(self, master: str, port: int, end: Callable[[str], None], links: Callable[[], List[BusLink]]) -> None:
        """`port`: of the data; `end(reason)`: this computer itself wants the node to end; `links()`: its connections."""
        self._master, self.port, self._end, self._links = master, port, end, links
        self.published: Dict[str, str] = {}  # topic -> type; replaced as a whole
        self.subscribed: Dict[str, str] = {}

    def methods(self) -> Dict[str, Method]:
        """The methods by their names."""
        return {
            "requestTopic": self._request_topic,
            "publisherUpdate": lambda caller, topic, publishers: [1, "", 0],  # the roscore itself is read
            "paramUpdate": lambda caller, key, value: [1, "", 0],
            "getPid": lambda caller: [1, "", os.getpid()],
            "getMasterUri": lambda caller: [1, "", self._master],
            "getPublications": lambda caller: [1, "", sorted(map(list, self.published.items()))],
            "getSubscriptions": lambda caller: [1, "", sorted(map(list, self.subscribed.items()))],
            "getBusInfo": lambda caller: [1, "", [list(_describe_link(link)) for link in self._links()]],
            "getBusStats": lambda caller: [1, "", self._count_bytes()],
            "shutdown": PerCaller(self._shut_down),
        }

    def _count_bytes(self) -> List[Any]:
        """The bytes and messages that have been sent: each topic with its connections. Those that came are not counted."""
        topics: Dict[str, List[BusLink]] = {}
        for link in self._links():
            if not link.inward:
                topics.setdefault(link.topic, []).append(link)
        sent = [
            [
                topic,
                _limit(sum(link.size for link in links)),
                [[link.number, _limit(link.size), _limit(link.messages), True] for link in links],
            ]
            for topic, links in topics.items()
        ]
        return [sent, [], []]

    def _request_topic(self, caller: Any, topic: Any, protocols: Any) -> List[Any]:
        if topic not in self.published:
            return [0, "it is not published here", []]
        if not isinstance(protocols, list) or not any(
            isinstance(one, list) and one[:1] == ["TCPROS"] for one in protocols
        ):
            return [0, "TCPROS is the only protocol here", []]
        return [1, "", ["TCPROS", find_own_host(), self.port]]

    def _shut_down(self, address: str, caller: Any, reason: Any = "") -> List[Any]:
        if address not in local_hosts():
            raise RefusedCall("only this computer itself ends this node")
        self._end(str(reason))
        return [1, "", 0]


def _describe_link(link: BusLink) -> Tuple[Any, ...]:
    return link.number, link.peer, "i" if link.inward else "o", "TCPROS", link.topic, 1, link.title


def _limit(number: int) -> int:
    """XML-RPC has 32 bits; a counter begins again, as those of roscpp do."""
    return number & 0x7FFFFFFF


class Registrar:
    """Keeps the registrations at the own roscore as they are wanted."""

    def __init__(self, roscore: Roscore, uri: str, workers: Workers) -> None:
        self._roscore, self._uri, self._workers = roscore, uri, workers
        self._wanted: Dict[Key, str] = {}
        self._made: Dict[Key, str] = {}  # with their types, or the URI of the service
        self._asked: Dict[Key, str] = {}  # the same, of the call that is under way
        self._busy, self._due, self._stale = False, 0.0, False
        self._asked_at = self._rests_until = 0.0  # it asks half of the time at most, whatever others offer

    def want(self, wanted: Dict[Key, str]) -> None:
        """Set the names to register, with their types."""
        if wanted != self._wanted:
            self._wanted, self._due = dict(wanted), 0.0

    def begin_again(self) -> None:
        """Register everything: the roscore may have forgotten it, also the names that are being registered."""
        self._made, self._due, self._stale = {}, 0.0, self._busy

    def withdraw(self) -> None:
        """Take all registrations back, at the end of the program: by the worker, after the call that is under way."""
        calls = [self._undo(key, kind) for key, kind in {**self._made, **self._asked}.items()]
        done = threading.Event()

        def undo() -> None:
            try:
                self._roscore.ask(*calls)
            finally:
                done.set()

        self._workers.submit(undo, lambda _answers, _problem: None)
        done.wait(WITHDRAWAL)

    def tick(self, now: float) -> Optional[float]:
        """Register all that is due; the time of the next call."""
        if self._busy or self._wanted == self._made:
            return None
        due = max(self._due, self._rests_until)
        if now < due:
            return due
        gone = [key for key in self._made if self._wanted.get(key) != self._made[key]]
        new = {key: kind for key, kind in self._wanted.items() if self._made.get(key) != kind}
        self._busy, self._asked_at, self._asked = True, now, new
        calls = [
            *(self._undo(key, self._made[key]) for key in gone),
            *((f"register{role}", name, what, self._uri) for (role, name), what in new.items()),
        ]
        self._workers.submit(partial(self._roscore.ask, *calls), partial(self._on_done, gone, new))
        return None

    def _undo(self, key: Key, kind: str) -> Tuple[Any, ...]:
        role, name = key
        return f"unregister{role}", name, kind if role == PROVIDER else self._uri

    def _on_done(self, gone: List[Key], new: Dict[Key, str], answers: Any, problem: Optional[Exception]) -> None:
        now = monotonic()
        self._busy, self._asked, self._rests_until = False, {}, now + (now - self._asked_at)
        if self._stale:
            self._stale = False
            return
        if answers is None:
            self._due = now + RETRY
            return
        for key in gone:
            self._made.pop(key, None)
        for key, answer in zip(new, answers[len(gone) :]):
            if answer is not None:
                self._made[key] = new[key]
        self._due = now + (RETRY if None in answers[len(gone) :] else 0.0)
