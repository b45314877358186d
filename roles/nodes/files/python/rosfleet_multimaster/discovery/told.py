# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Changes, as others are told of them: they ask, and have the answer as soon as there is something new for them.

Nothing is kept about a caller but its filter. Epoch and revision in its question say what it has. The epoch names this
start, the rules that the caller is told by, and its filter: with other rules nothing is told but the whole.
"""

import os
import threading
from collections import OrderedDict
from typing import Any, Callable, Dict, Hashable, List, NamedTuple, Optional, Tuple

from ..edge.clock import monotonic
from ..protocol.differences import History, changes, difference_in_view, digest, empty_difference
from ..protocol.filters import Rules
from ..protocol.graph import State, parse, stamp_text
from .rpc_server import Refused

LONGEST_WAIT = 60.0  # seconds
MOST_FILTERS, MOST_TEXT = 512, 1 << 22  # filters that are remembered, and their characters
FILTERS_PER_CALLER = 8
MOST_READY = 8  # whole states that are kept as they are sent, packed

Key = Tuple[str, str]  # caller, epoch


def _as_it_is(answer: Any) -> Any:
    return answer


class Look(NamedTuple):
    """The present view of a caller: the rules, as something to compare, and the document that they make of a state."""

    rules: Hashable
    document: Callable[[State], List[Any]]
    written: Callable[[Any], Any] = _as_it_is  # makes of a whole answer what travels


class Told:
    """The answers to questions for differences. Asked in threads of the server, which wait here."""

    def __init__(self, current: Callable[[], Any], ready: Callable[[Any], Any] = _as_it_is) -> None:
        """`current()` raises Refused while there is no state to tell. `ready(answer)`: a whole state as it is kept and sent."""
        self._current, self._start = current, os.urandom(6).hex()
        self._changed = threading.Condition()
        self._history = History()
        self._state: Optional[State] = None
        self._secret: Any = None
        self._news = 0  # counts what those who wait are woken for
        self._own = 0  # revision of the last one
        self._filters: OrderedDict[Key, Tuple[Rules, int]] = OrderedDict()
        self._digests: Dict[Tuple[str, int], str] = {}  # of the present revision
        self._ready, self._making = ready, threading.Lock()
        self._wholes: OrderedDict[Tuple[int, Hashable], Any] = OrderedDict()  # by revision and rules

    def news(self, state: State, secret: Any) -> None:
        """Take the state and what is secret now, and wake who waits where either is another, and not only what is of others."""
        if state is self._state and secret == self._secret:
            return
        replaced = changes(self._state, state) if self._state is not None else {}
        with self._changed:
            same = self._state is not None and state.local_stamp == self._state.local_stamp and secret == self._secret
            if state is not self._state:
                self._history.add(replaced)
                self._digests.clear()
            self._state, self._secret = state, secret
            if not same:  # what came from others is with the next answer: each of them knows it, too
                self._news, self._own = self._news + 1, self._history.revision
                self._changed.notify_all()

    def filter_of(self, caller: str, epoch: str) -> Rules:
        """The filter that a caller gave before. Raises Refused."""
        with self._changed:
            found = self._filters.get((caller, epoch))
        if found is None:
            raise Refused("the filter of this epoch is not known any more")
        return found[0]

    def _remember(self, caller: str, epoch: str, wanted: Rules) -> None:
        size = sum(len(pattern.text) for pattern in vars(wanted).values())
        with self._changed:
            self._filters[caller, epoch] = (wanted, size)
            self._filters.move_to_end((caller, epoch))
            own = [key for key in self._filters if key[0] == caller]
            if len(own) > FILTERS_PER_CALLER:  # nobody makes the others' forgotten
                del self._filters[own[0]]
            while len(self._filters) > MOST_FILTERS or sum(held for _rules, held in self._filters.values()) > MOST_TEXT:
                self._filters.popitem(last=False)

    def answer(
        self, caller: str, wanted: Rules, look: Callable[[], Look], known: str, revision: int, seconds: float
    ) -> Any:
        """[epoch, revision, whole, document, gone, digest]: as soon as something is new, or after these seconds.

        `look()` is asked again each time, since the rules for the caller may have changed.
        """
        until, asked = monotonic() + seconds, revision
        begun_at: Optional[float] = None
        while True:
            with self._changed:
                state, now, seen, own = self._state, self._history.revision, self._news, self._own
                undo = self._history.undo_since(revision)
            self._current()
            if state is None:
                raise Refused("there is no state yet")
            seeing = look()
            epoch = f"{self._start}{hash(seeing.rules) & 0xFFFFFFFFFFFFFFFF:016x}"
            found = difference_in_view(state, undo, seeing.document) if epoch == known and undo is not None else None
            if found is None:
                self._remember(caller, epoch, wanted)
                return self._whole(epoch, now, state, seeing)
            begun_at = state.local_stamp if begun_at is None else begun_at
            if found or asked < own or state.local_stamp != begun_at:
                return [epoch, now, False, *found, ""]
            revision = asked = now  # a change that the rules hide: nothing to tell
            if not self._wait(seen, until):
                nothing = empty_difference(state, [stamp_text(state.stamp), stamp_text(state.local_stamp)])
                return [epoch, now, False, *nothing, self._digest(epoch, now, state, seeing)]

    def _whole(self, epoch: str, now: int, state: State, seeing: Look) -> Any:
        """A whole state, made once for all who ask by the same rules: those of a fleet that meets ask all at once."""
        key = (now, seeing.rules)
        with self._making:
            if key not in self._wholes:
                while len(self._wholes) >= MOST_READY:
                    self._wholes.popitem(last=False)
                self._wholes[key] = self._ready(
                    seeing.written([epoch, now, True, seeing.document(state), [[], [], []], ""])
                )
            return self._wholes[key]

    def _wait(self, seen: int, until: float) -> bool:
        """Wait for news; False where there are none until then."""
        with self._changed:
            return self._changed.wait_for(lambda: self._news != seen, max(0.0, until - monotonic()))

    def _digest(self, epoch: str, revision: int, state: State, seeing: Look) -> str:
        found = self._digests.get((epoch, revision))
        if found is None:
            found = self._digests[epoch, revision] = digest(parse(seeing.document(state)))
        return found
