# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The changes of another master, followed: it is asked for what is new, and answers as soon as there is something."""

import random
from typing import Any, Callable, Dict, List, Optional

from ..edge.addresses import address_of, network, networks
from ..edge.clock import monotonic, processor_time
from ..edge.loop import EndFlag, start_thread
from ..edge.rpc_client import Rpc
from ..protocol import json_text
from ..protocol.differences import apply_difference, digest
from ..protocol.graph import InvalidDocument, State, parse
from ..protocol.members import Members, Networks
from .core.limits import limit_state, size
from .core.pace import Pace
from .core.places import LocalNetwork, Places, names_to_resolve
from .core.sync import Fetch

WAIT = (20.0, 30.0)  # seconds that an answer may take: not the same for all who ask
TIMEOUT = 10.0  # seconds for an answer besides
HERE = 1.0  # seconds that the own addresses count as known
LOOKUPS = 3.0  # seconds for the names in a state that the plan does not have
MOST = 10_000  # registrations of a state that is followed, those of others too; a larger one is fetched as a whole

Misplaced = Dict[str, str]  # URI of a node or service -> why it is refused


class TooMuch(Exception):
    """The state is too large to be followed."""


class Answer:
    """An answer to a question for differences. Raises Malformed."""

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
            raise InvalidDocument("it does not say whether it is whole, or its digest is no text")

    def state(self, before: Optional[State]) -> State:
        """The state now. Raises Malformed."""
        if self.whole:
            return parse(self.document)
        if before is None:
            raise InvalidDocument("a difference, where a whole state was asked for")
        return apply_difference(before, self.document, self.gone)


class Surroundings:
    """This computer, as it was a moment ago at most: the kernel's lists cost more than a change."""

    def __init__(self) -> None:
        self._here: Optional[LocalNetwork] = None
        self._looked = 0.0

    def here(self) -> LocalNetwork:
        """The own addresses and networks. Raises OSError."""
        now = monotonic()
        if self._here is None or now - self._looked > HERE:
            self._here, self._looked = LocalNetwork(frozenset(network().own), Networks(networks())), now
        return self._here


class View:
    """The state of one master as far as it is taken here, and where its nodes may be."""

    def __init__(
        self, fetch: Fetch, own_uri: str, sync_remote_nodes: bool, members: Members, around: Surroundings
    ) -> None:
        self._fetch, self._own_uri, self._remote_nodes, self._members = fetch, own_uri, sync_remote_nodes, members
        self.wanted = fetch.rules.to_wire(sync_remote_nodes)
        self._around = around

    def taken(self, state: State, before: Optional[State]) -> State:
        """As much of a state as is taken. `before`: what was taken of this master until now."""
        return limit_state(state, before, own_uri=self._own_uri, sync_remote_nodes=self._remote_nodes)

    def places(self, state: State) -> Places:
        """Where the nodes of a state may be."""
        resolved = _resolved(names_to_resolve(state, self._members))
        return Places(self._members, self._fetch.uri, self._fetch.monitor_uri, self._around.here(), resolved)


def _resolved(names: List[str]) -> Dict[str, str]:
    """The addresses of names, of as many as can be looked up in a short time."""
    until, found = monotonic() + LOOKUPS, {}
    for name in names:
        if monotonic() > until:
            break
        try:
            found[name] = address_of(name)
        except (OSError, UnicodeError):  # one that is no host name
            pass
    return found


class Follower:
    """Follows one master, in a thread of its own."""

    def __init__(
        self, rpc: Rpc, method: str, fetch: Fetch, view: View, answer: Answer, state: State, taken: State
    ) -> None:
        """`method` is asked for the differences; `answer`: the one with the whole state; `taken`: what is taken of it."""
        self.fetch, self._method = fetch, method
        self._rpc, self._view, self._taken, self._state = rpc, view, taken, state
        self._epoch, self._revision = answer.epoch, answer.revision
        self._pace, self._ended = Pace(), EndFlag()

    def start(
        self, told: Callable[["Follower", State, Misplaced], None], over: Callable[["Follower", Exception], None]
    ) -> None:
        """Begin to ask. The callbacks are called in the thread: with a new state, and with why there will be no more."""

        def follow() -> None:
            try:
                while not self._ended:
                    self._ask(told)
            except Exception as problem:  # whatever another computer makes of it
                problem.__traceback__ = problem.__context__ = problem.__cause__ = None
                if not self._ended:
                    over(self, problem)
            finally:
                self._rpc.close()

        start_thread("follow", follow)

    def stop(self) -> None:
        """Ask no more."""
        self._ended.set()
        self._rpc.cut()

    def _ask(self, told: Callable[["Follower", State, Misplaced], None]) -> None:
        """Ask once, and wait until the next question."""
        wait = random.uniform(*WAIT)
        began, spent = monotonic(), processor_time()
        self._rpc.limit(wait + TIMEOUT)
        wanted = [] if self._epoch else self._view.wanted  # it is known as long as the epoch is
        answer = self._rpc.call(self._method, wanted, self._epoch, self._revision, wait, read=Answer)
        if self._ended:
            return
        answered = monotonic()
        before, self._state = self._state, answer.state(self._state)
        news = self._state != before
        if answer.digest and answer.digest != digest(self._state):
            answer.epoch = ""  # whatever it was that went wrong: the whole again
        if news:
            self._tell(told)
        self._epoch, self._revision = answer.epoch, answer.revision
        now = monotonic()
        early = not news and not answer.whole and answered - began < wait / 2
        self._ended.wait(self._pace.next(now, processor_time() - spent, answer.whole, early) - now)

    def _tell(self, told: Callable[["Follower", State, Misplaced], None]) -> None:
        if size(self._state) > MOST:
            raise TooMuch(f"it has more than {MOST} registrations")
        self._taken = self._view.taken(self._state, self._taken)
        told(self, self._taken, self._view.places(self._taken).objections(self._taken))
