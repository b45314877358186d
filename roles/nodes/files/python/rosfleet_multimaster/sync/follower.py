# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Follows the changes of another master: it is asked for news, and answers as soon as there are some."""

import random
from typing import Any, Callable, Dict, Optional

from ..edge.addresses import addresses_of_all, network, networks
from ..edge.clock import keep_fresh, monotonic, processor_time
from ..edge.loop import EndFlag, start_thread
from ..edge.patience import Pace
from ..edge.rpc_client import Rpc
from ..protocol import json_text
from ..protocol.differences import apply_difference, digest
from ..protocol.graph import InvalidDocument, State, parse
from ..protocol.members import Networks
from ..protocol.wire_filters import write_rules
from .core.limits import MOST, limit_state, size
from .core.places import LocalNetwork, Places, names_to_resolve
from .core.sync import Fetch, Sync
from .state_room import StateRoom

WAIT = (20.0, 30.0)  # seconds that a master may wait for news: random, so that not all ask at once
TIMEOUT = 10.0  # seconds more for the answer
LOOKUPS = 3.0  # seconds for the names in a state that the plan does not have

Misplaced = Dict[str, str]  # URI of a node or service -> why it is refused


class StateTooLarge(Exception):
    """The state is too large to be followed."""


class DifferencesAnswer:
    """An answer to a question for differences. Raises InvalidDocument."""

    def __init__(self, value: Any) -> None:
        if isinstance(value, str):
            try:
                value = json_text.from_json(value)
            except ValueError as problem:
                raise InvalidDocument(f"no values: {problem}") from None
        if not isinstance(value, (list, tuple)) or len(value) != 6:
            raise InvalidDocument("not an array of six elements")
        self.epoch, self.revision, self.whole, self.document, self.gone, self.digest = value
        if not isinstance(self.epoch, str) or not 0 < len(self.epoch) < 100 or not isinstance(self.revision, int):
            raise InvalidDocument("its epoch is no short text, or its revision no number")
        if not isinstance(self.whole, bool) or not isinstance(self.digest, str):
            raise InvalidDocument("it does not say if it is whole, or its digest is no text")

    def state(self, before: Optional[State]) -> State:
        """The state now. Raises InvalidDocument."""
        if self.whole:
            return parse(self.document)
        if before is None:
            raise InvalidDocument("a difference; asked for a whole state")
        return apply_difference(before, self.document, self.gone)


@keep_fresh
def read_network() -> LocalNetwork:
    """The own addresses and networks. To read them takes longer than to handle a change. Raises OSError."""
    return LocalNetwork(frozenset(network().own), Networks(networks()))


class StateFilter:
    """The part of one master's states that is taken here, and the places of its nodes."""

    def __init__(self, fetch: Fetch, core: Sync, room: StateRoom) -> None:
        self._fetch, self._core, self._room = fetch, core, room
        self.rules = write_rules(fetch.rules, core.sync_remote_nodes)  # for the master

    def limit(self, state: State, before: Optional[State]) -> State:
        """The part of a state that is taken. `before`: the part that was taken until now. Raises InvalidDocument."""
        core = self._core
        if state.uri != self._fetch.uri:
            raise InvalidDocument(f"it is about {state.uri}, and not about {self._fetch.uri}")
        most = min(MOST, self._room.find(state.uri))
        return limit_state(state, before, most, core.own_uri, core.sync_remote_nodes)

    def hold(self, state: State) -> bool:
        """Count the held bytes of a state. False if it is too much."""
        return self._room.hold(self._fetch.uri, size(state))

    def find_misplaced(self, state: State) -> Misplaced:
        """The nodes and services of a state that cannot be at the places that it gives."""
        members, fetch = self._core.members, self._fetch
        addresses = addresses_of_all(names_to_resolve(state, members), LOOKUPS)
        places = Places(members, fetch.uri, fetch.monitor_uri, read_network(), addresses)
        return places.find_refusals(state)


class Follower:
    """Follows one master, in a thread of its own."""

    def __init__(
        self,
        rpc: Rpc,
        method: str,
        fetch: Fetch,
        states: StateFilter,
        answer: DifferencesAnswer,
        state: State,
        part: State,
    ) -> None:
        """`method` gives the differences; `answer` had the whole state; `part` of it is taken."""
        self.fetch, self._method = fetch, method
        self._rpc, self._states, self._part, self._state = rpc, states, part, state
        self._epoch, self._revision = answer.epoch, answer.revision
        self._pace, self._ended = Pace(), EndFlag()

    def start(
        self, on_news: Callable[["Follower", State, Misplaced], None], on_end: Callable[["Follower", Exception], None]
    ) -> None:
        """Begin to ask. The callbacks are called in the thread: with a new state, and with the reason of the end."""

        def follow() -> None:
            try:
                while not self._ended:
                    self._ask(on_news)
            except Exception as problem:  # any: the answers are another computer's
                problem.__traceback__ = problem.__context__ = problem.__cause__ = None
                if not self._ended:
                    on_end(self, problem)
            finally:
                self._rpc.close()

        start_thread("follow", follow)

    def stop(self) -> None:
        """Ask no more."""
        self._ended.set()
        self._rpc.cut()

    def _ask(self, on_news: Callable[["Follower", State, Misplaced], None]) -> None:
        """Ask once, and wait until the next question."""
        wait = random.uniform(*WAIT)
        began, spent = monotonic(), processor_time()
        self._rpc.limit(wait + TIMEOUT)
        rules = [] if self._epoch else self._states.rules  # the master knows the rules of an epoch
        answer = self._rpc.call(self._method, rules, self._epoch, self._revision, wait, read=DifferencesAnswer)
        if self._ended:
            return
        answered = monotonic()
        before, self._state = self._state, answer.state(self._state)
        news = self._state != before
        if answer.digest and answer.digest != digest(self._state):
            answer.epoch = ""  # something went wrong: ask for the whole state
        if news:
            if not self._states.hold(self._state):
                raise StateTooLarge(f"it has {size(self._state)} registrations")
            self._part = self._states.limit(self._state, self._part)
            on_news(self, self._part, self._states.find_misplaced(self._part))
        self._epoch, self._revision = answer.epoch, answer.revision
        now = monotonic()
        early = not news and not answer.whole and answered - began < wait / 2
        self._ended.wait(self._pace.next(now, processor_time() - spent, answer.whole, early) - now)
