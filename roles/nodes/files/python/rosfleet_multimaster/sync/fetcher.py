# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Fetches the states of other masters from their discovery nodes, and follows their changes."""

from functools import partial
from typing import Any, Callable, Dict, NamedTuple, Optional, Set, cast
from xmlrpc.client import Fault

from ..edge.clock import monotonic
from ..edge.loop import Loop, Workers
from ..edge.process import program
from ..edge.rpc_client import Rpc
from ..protocol.differences import DIFFERENCES, PACKED
from ..protocol.graph import InvalidDocument, State, parse
from ..protocol.messages import Registration
from ..protocol.plain_text import quote
from ..protocol.xml_rpc import STATE, DocumentTooLarge
from .core.sync import Fetch, Sync
from .follower import TIMEOUT, DifferencesAnswer, Follower, Misplaced, StateFilter
from .state_room import StateRoom

MOST_FOLLOWED = 128  # masters: more are fetched when they announce a change


class FetchResult(NamedTuple):
    """A state, its misplaced nodes, and a follower of its changes."""

    state: State
    misplaced: Misplaced
    follower: Optional[Follower]


class Fetcher:
    """Carries out the fetches of the core, and follows the masters that report their changes."""

    def __init__(
        self,
        loop: Loop,
        core: Sync,
        limited: program.LimitedLog,
        on_state: Callable[[str, Set[Registration]], None],
        on_changes: Callable[[str, Set[Registration]], None],
        differences: bool = True,
    ) -> None:
        """`on_state(uri, items)`: after a fetch, these registrations may have changed; `on_changes`: the same of a followed master.

        `differences`: masters are followed.
        """
        self._workers, self._loop = Workers(loop, 8), loop
        self._core, self._limited, self._on_state, self._on_changes = core, limited, on_state, on_changes
        self._differences = differences
        self._followers: Dict[str, Follower] = {}
        self._room = StateRoom(core.members)
        self.states = self.changes = 0  # received

    def tick(self, now: float) -> float:
        """Fetch all that is due; the time of the next fetch."""
        for uri in [uri for uri, follower in self._followers.items() if not self._core.follows(follower.fetch)]:
            self._stop(uri)
        self._room.keep(self._core.remotes)
        for fetch in self._core.due(now):
            self._stop(fetch.uri)
            before = self._core.remotes[fetch.uri].state
            quick = self._differences and len(self._followers) < MOST_FOLLOWED
            job = partial(_fetch, fetch, before, StateFilter(fetch, self._core, self._room), quick)
            self._workers.submit(job, partial(self._on_fetch, fetch))
        return self._core.next_due()

    def _on_fetch(self, fetch: Fetch, result: Optional[FetchResult], problem: Optional[Exception]) -> None:
        state, misplaced, follower = result or (None, {}, None)
        items = self._core.take_fetch(fetch, state, monotonic(), misplaced, following=follower is not None)
        if follower is not None and items is not None:
            self._followers[fetch.uri] = follower
            follower.start(partial(self._loop.post, self._on_news), partial(self._loop.post, self._on_end))
        elif follower is not None:
            follower.stop()
        if items is not None:
            self.states += 1
            self._on_state(fetch.uri, items)
        elif problem is not None:
            self._limited.say(
                "warning",
                f"fetch {fetch.uri}",
                f"the state of {fetch.uri} cannot be had from {fetch.monitor_uri}: {quote(problem)}{_advice(problem)}",
            )

    # The followed masters

    def _on_news(self, follower: Follower, state: State, misplaced: Misplaced) -> None:
        if self._followers.get(follower.fetch.uri) is follower and self._core.follows(follower.fetch):
            self.changes += 1
            self._on_changes(follower.fetch.uri, self._core.take_change(follower.fetch.uri, state, misplaced))

    def _on_end(self, follower: Follower, problem: Exception) -> None:
        uri = follower.fetch.uri
        if self._followers.get(uri) is follower:
            program.LOG.debug("the changes of %s are not followed any more: %s", uri, problem)
            self._stop(uri)

    def _stop(self, uri: str) -> None:
        follower = self._followers.pop(uri, None)
        if follower is not None:
            follower.stop()
            self._core.end_following(uri, monotonic())


def _advice(problem: Exception) -> str:
    if not isinstance(problem, DocumentTooLarge):
        return ""
    return "; nothing new of it is taken, its registrations stay: leave out there the topics that nobody needs, by multimaster_exports"


def _fetch(fetch: Fetch, before: Optional[State], states: StateFilter, quick: bool) -> FetchResult:
    """The part of a master's state that is taken. The master filters it, if it can. `quick`: its changes may be followed."""
    rpc = Rpc(fetch.monitor_uri, TIMEOUT, STATE)
    follower: Optional[Follower] = None
    try:
        method = _method(rpc) if quick else ""
        if method:
            answer, state = rpc.call(method, states.rules, "", 0, 0, read=_read_answer)
            part = states.limit(state, before)
            if states.hold(state):
                follower = Follower(rpc, method, fetch, states, answer, state, part)
        else:
            part = _fetch_whole(rpc, states.rules, lambda value: states.limit(parse(value), before))
        if follower is None:
            states.hold(part)
        return FetchResult(part, states.find_misplaced(part), follower)
    except InvalidDocument as problem:
        raise ValueError(f"it sends no state of a master: {problem}") from None
    finally:
        if follower is None:
            rpc.close()


def _read_answer(value: Any) -> Any:
    answer = DifferencesAnswer(value)
    state = answer.state(None)
    answer.document = None  # it is large
    return answer, state


def _method(rpc: Rpc) -> str:
    """The best method that reports this master's changes, "" without one."""

    def select(methods: Any) -> str:
        return next((name for name in (PACKED, DIFFERENCES) if isinstance(methods, list) and name in methods), "")

    try:
        return str(rpc.call("system.listMethods", read=select))
    except Fault:
        return ""


def _fetch_whole(rpc: Rpc, rules: Any, read: Callable[[Any], State]) -> State:
    """The state of a master that does not report its changes: of upstream, or if this is switched off."""
    try:
        return cast(State, rpc.call("masterInfoFiltered", rules, read=read))
    except Fault:
        if "masterInfoFiltered" in rpc.call("system.listMethods"):
            raise
        return cast(State, rpc.call("masterInfo", read=read))
