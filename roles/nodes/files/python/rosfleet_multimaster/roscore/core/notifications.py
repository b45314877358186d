# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The queue of calls that notify nodes of changes.

- A newer call replaces a waiting one: a node has at most one waiting call for a topic.
- A node has one call at a time, in the order of the last changes.
- A first change is sent at once. Further ones of the same topic wait a little, and each time longer: a burst is a few calls.
- A node that does not answer in time is called again later. Such nodes have few workers together, and so has each host:
  a lost robot keeps no own node waiting.
"""

from collections import OrderedDict
from typing import Any, Dict, Iterator, List, NamedTuple, Optional, Set, Tuple

WORKERS = 64  # calls at once,
PER_HOST = 24  # to nodes of one host,
QUICK = 8  # so many of them younger than
YOUNG = 0.1  # seconds: a node that answers has done so by then
SLOW = 4  # calls to nodes that did not answer in time
PAUSE, LONGEST = 0.01, 0.64  # seconds between two calls of one topic: at first, and at most
BURST = 3  # a change within so many pauses after the last call makes the pause longer: twice as long,
MANY = 4  # or as many times as there were so many changes since
QUIET = 3.0  # seconds after which nothing is known of earlier calls
RETRY, LATEST = 1.0, 16.0  # seconds until a silent node is called again, doubled up to
PATIENCE = 60.0  # seconds after which calls for such a node are dropped

Key = Tuple[str, str]  # method, and the topic or parameter


class NodeCall(NamedTuple):
    """One call of a node."""

    uri: str
    method: str
    arguments: Tuple[Any, ...]
    key: Key
    changes: int = 1  # that it announces


class _Node:
    """A node that is to be notified, or was a moment ago."""

    def __init__(self, host: str) -> None:
        self.host, self.busy = host, False
        self.waiting: OrderedDict[Key, NodeCall] = OrderedDict()
        self.history: Dict[Key, Tuple[float, float]] = {}  # key -> time of its last call, and the pause after that
        self.silent_since: Optional[float] = None
        self.again, self.pause = 0.0, RETRY


class Notifications:
    """The calls that wait. Times are given; nothing here waits."""

    def __init__(self) -> None:
        self._nodes: Dict[str, _Node] = {}
        self._ready: OrderedDict[str, None] = OrderedDict()  # URIs with something that waits, and no call under way
        self._busy: Dict[str, Dict[str, float]] = {}  # host -> URI of a node with a call under way -> since when
        self._slow: Set[str] = set()  # URIs of silent nodes with a call under way

    def add(self, uri: str, host: str, method: str, name: str, arguments: Tuple[Any, ...]) -> None:
        """Add a call of a node. It replaces the waiting one of the same method and name."""
        node = self._nodes.get(uri)
        if node is None:
            node = self._nodes[uri] = _Node(host)
        before = node.waiting.pop((method, name), None)
        changes = 1 if before is None else before.changes + 1
        node.waiting[method, name] = NodeCall(uri, method, arguments, (method, name), changes)
        if not node.busy:
            self._ready.setdefault(uri)

    def next(self, now: float) -> Tuple[Optional[NodeCall], Optional[float]]:
        """The call to make now, or the time at which there may be one. (None, None): `add` or `finish` brings the next one."""
        earliest: Optional[float] = None
        room = {host: self._next_slot(calls, now) for host, calls in self._busy.items()}
        for uri in self._candidates():
            node = self._nodes[uri]
            key, due = self._find_first(node, now)
            due = max(due, room.get(node.host, now))
            if due <= now:
                self._begin(uri, node, now)
                return node.waiting.pop(key), None
            earliest = due if earliest is None else min(due, earliest)
        return None, earliest

    def finish(self, call: NodeCall, now: float, answered: bool, gone: bool = False) -> None:
        """End a call. `answered`: in time; `gone`: its port is closed."""
        node = self._nodes[call.uri]
        node.busy = False
        self._slow.discard(call.uri)
        del self._busy[node.host][call.uri]
        if not self._busy[node.host]:
            del self._busy[node.host]
        if gone:
            del self._nodes[call.uri]
            return
        if answered:
            node.silent_since, node.pause = None, RETRY
            last, pause = node.history.get(call.key, (now - QUIET, PAUSE))
            burst = call.changes > MANY or now - last < BURST * pause
            longer = min(pause * max(2, call.changes / MANY), LONGEST)
            node.history[call.key] = (now, longer if burst else PAUSE)
        else:
            self._note_silence(node, call, now)
        if node.waiting:
            self._ready[call.uri] = None
        elif node.silent_since is None and len(node.history) > 64:
            node.history = {key: (at, pause) for key, (at, pause) in node.history.items() if now - at < QUIET}
        if not node.waiting and not node.history:
            del self._nodes[call.uri]

    def waits(self) -> bool:
        """True if a call waits for a node that has no call under way."""
        return bool(self._ready)

    def tidy(self, now: float) -> None:
        """Forget nodes that have had all their calls a while ago."""
        for uri, node in list(self._nodes.items()):
            if not node.busy and not node.waiting and all(now - at > QUIET for at, _pause in node.history.values()):
                del self._nodes[uri]

    def _candidates(self) -> Iterator[str]:
        full = {host for host, calls in self._busy.items() if len(calls) >= PER_HOST}
        for uri in self._ready:
            node = self._nodes[uri]
            if node.host not in full and (node.silent_since is None or len(self._slow) < SLOW):
                yield uri

    def _next_slot(self, calls: Dict[str, float], now: float) -> float:
        """The time at which the next node of a host may be called."""
        young = sorted(since for since in calls.values() if now - since < YOUNG)
        return now if len(young) < QUICK else young[-QUICK] + YOUNG

    def _find_first(self, node: _Node, now: float) -> Tuple[Key, float]:
        """The key that may be sent first, and when."""
        best: List[Any] = []
        for key in node.waiting:
            at, pause = node.history.get(key, (0.0, 0.0))
            due = max(at + pause, node.again if node.silent_since is not None else 0.0)
            if due <= now:
                return key, due
            if not best or due < best[1]:
                best = [key, due]
        return best[0], best[1]

    def _begin(self, uri: str, node: _Node, now: float) -> None:
        node.busy = True
        del self._ready[uri]
        self._busy.setdefault(node.host, {})[uri] = now
        if node.silent_since is not None:
            self._slow.add(uri)

    def _note_silence(self, node: _Node, call: NodeCall, now: float) -> None:
        if node.silent_since is None:
            node.silent_since = now
        node.again, node.pause = now + node.pause, min(2 * node.pause, LATEST)
        if now - node.silent_since > PATIENCE:
            node.waiting.clear()
            node.silent_since, node.pause = None, RETRY
        elif call.key not in node.waiting:  # else something newer waits already
            node.waiting[call.key] = call
            node.waiting.move_to_end(call.key, last=False)
