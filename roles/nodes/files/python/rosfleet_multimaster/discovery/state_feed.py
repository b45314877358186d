# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The feed of state changes: other masters ask, and get an answer as soon as something is new for them.

Only the filter of a caller is kept. Epoch and revision in its question say which state it has. The epoch identifies this
start, the rules for the caller, and its filter: when one of them changes, the caller gets a whole state.
"""

import os
import threading
from collections import Counter, OrderedDict
from typing import Any, Callable, Dict, Hashable, List, NamedTuple, Optional, Tuple

from ..edge.clock import monotonic
from ..edge.rpc_server import PackedAnswer, RefusedCall
from ..protocol.differences import History, changes, difference_in_view, digest, empty_difference
from ..protocol.filters import Rules
from ..protocol.graph import State, parse

LONGEST_WAIT = 60.0  # seconds
MOST_FILTERS, FILTERS_OF_ONE = 512, 8  # filters that are kept, and those of one robot
MOST_BYTES, BYTES_OF_ONE = 32 << 20, 2 << 20  # of their memory; one filter is always kept
_PATTERN = 200  # bytes of a pattern besides its characters
MOST_READY = 8  # whole states that are kept, packed

Key = Tuple[str, str]  # robot, epoch


class CallerView(NamedTuple):
    """The present view of a caller."""

    rules: Hashable  # views with equal rules are equal
    document: Callable[[State], List[Any]]
    encode: Callable[[Any], Any] = list  # makes of a whole answer the value that is sent


class StateFeed:
    """The answers to questions for differences. They are made in threads of the server, which wait here."""

    def __init__(
        self,
        current: Callable[[], Any],
        pack: Callable[[Any], Any] = PackedAnswer,
        robot_at: Callable[[str], str] = str,
    ) -> None:
        """`current()` raises RefusedCall while there is no state. `pack(answer)`: the form of a whole state that is kept and sent.

        `robot_at(address)`: who pays for the kept data.
        """
        self._current, self._start, self._robot_at = current, os.urandom(6).hex(), robot_at
        self._changed = threading.Condition()
        self._history = History()
        self._state: Optional[State] = None
        self._secret: Any = None
        self._news = 0  # the number of changes that woke the waiting threads
        self._own = 0  # revision of the last of these
        self._filters: OrderedDict[Key, Tuple[Rules, int]] = OrderedDict()
        self._digests: Dict[Tuple[str, int], str] = {}  # of the present revision
        self._pack, self._making = pack, threading.Lock()
        self._wholes: OrderedDict[Tuple[int, Hashable], Any] = OrderedDict()  # by revision and rules

    def update(self, state: State, secret: Any) -> None:
        """Take the state and the secret topics. Wake the waiting threads, if an own node or a secret has changed."""
        if state is self._state and secret == self._secret:
            return
        replaced = changes(self._state, state) if self._state is not None else {}
        with self._changed:
            same = self._state is not None and state.local_stamp == self._state.local_stamp and secret == self._secret
            if state is not self._state:
                self._history.add(replaced)
                self._digests.clear()
            self._state, self._secret = state, secret
            if not same:  # changes of other masters go with the next answer: each caller hears of them itself
                self._news, self._own = self._news + 1, self._history.revision
                self._changed.notify_all()

    def find_filter(self, caller: str, epoch: str) -> Rules:
        """The filter that a computer of the caller's robot gave before. Raises RefusedCall."""
        with self._changed:
            entry = self._filters.get((self._robot_at(caller), epoch))
        if entry is None:
            raise RefusedCall("the filter of this epoch is not known any more")
        return entry[0]

    def _remember(self, caller: str, epoch: str, rules: Rules) -> None:
        """Keep a filter. If there are too many, the oldest one of the robot with most goes: a robot pushes out its own filters alone."""
        robot = self._robot_at(caller)
        size = sum(_PATTERN + len(item) for pattern in vars(rules).values() for item in pattern.items)
        with self._changed:
            self._filters[robot, epoch] = (rules, size)
            self._filters.move_to_end((robot, epoch))
            self._make_room(robot, FILTERS_OF_ONE, BYTES_OF_ONE)
            while (
                len(self._filters) > MOST_FILTERS or sum(size for _rules, size in self._filters.values()) > MOST_BYTES
            ):
                held: Counter[str] = Counter()
                for (one, _epoch), (_rules, size) in self._filters.items():
                    held[one] += size + 1
                ((fullest, _size),) = held.most_common(1)
                del self._filters[next(key for key in self._filters if key[0] == fullest)]

    def _make_room(self, robot: str, most: int, most_bytes: int) -> None:
        """Forget the oldest filters of a robot that has too many. The lock is held."""
        own = [key for key in self._filters if key[0] == robot]
        while len(own) > most or (sum(self._filters[key][1] for key in own) > most_bytes and len(own) > 1):
            del self._filters[own.pop(0)]

    def answer(
        self, caller: str, rules: Rules, make_view: Callable[[], CallerView], known: str, revision: int, seconds: float
    ) -> Any:
        """[epoch, revision, whole, document, gone, digest]: as soon as something is new, or after these seconds.

        `rules`: the filter of the caller; `known`: its epoch. `make_view()` is called for each news: the rules may be new.
        """
        until, asked = monotonic() + seconds, revision
        begun_at: Optional[float] = None
        while True:
            with self._changed:
                state, now, news, own = self._state, self._history.revision, self._news, self._own
                undo = self._history.undo_since(revision)
            self._current()
            if state is None:
                raise RefusedCall("there is no state yet")
            view = make_view()
            epoch = f"{self._start}{hash(view.rules) & 0xFFFFFFFFFFFFFFFF:016x}"
            difference = difference_in_view(state, undo, view.document) if epoch == known and undo is not None else None
            if difference is None:
                self._remember(caller, epoch, rules)
                return self._whole(epoch, now, state, view)
            begun_at = state.local_stamp if begun_at is None else begun_at
            if difference or asked < own or state.local_stamp != begun_at:
                return [epoch, now, False, *difference, ""]
            revision = asked = now  # the rules hide the change: there is nothing to report
            if not self._wait(news, until):
                return [epoch, now, False, *empty_difference(state), self._digest(epoch, now, state, view)]

    def _whole(self, epoch: str, now: int, state: State, view: CallerView) -> Any:
        """A whole state, made once for all callers with the same rules: in a fleet that starts, all ask at once."""
        key = (now, view.rules)
        with self._making:
            if key not in self._wholes:
                while len(self._wholes) >= MOST_READY:
                    self._wholes.popitem(last=False)
                self._wholes[key] = self._pack(view.encode([epoch, now, True, view.document(state), [[], [], []], ""]))
            return self._wholes[key]

    def _wait(self, news: int, until: float) -> bool:
        """Wait for news; False if no news comes until then."""
        with self._changed:
            return self._changed.wait_for(lambda: self._news != news, max(0.0, until - monotonic()))

    def _digest(self, epoch: str, revision: int, state: State, view: CallerView) -> str:
        key = (epoch, revision)
        found = self._digests.get(key)
        if found is None:
            found = digest(parse(view.document(state)))
            if len(self._digests) >= MOST_FILTERS:  # there is one for each filter, and a state may stay for days
                self._digests.clear()
            self._digests[key] = found
        return found
